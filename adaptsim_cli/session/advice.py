"""The next commands after an iteration, by its verdict. Pure."""

from __future__ import annotations

from adaptsim_cli.config import same_lab
from adaptsim_cli.session.records import Facts, ResultRecord

ENOUGH_ITERATIONS = 5
"""The paper's number of iterations."""

GO_ON, ENOUGH, HOPELESS = "Go on: reward", "Stop here: reward", "Stop here: no action"
TOO_FEW, NOT_YET, CONVERGED = "Too few trials to judge", "Not converged yet", "Converged"
STAYS_LOW, CANNOT_EXPRESS = "Reward stays low", "cannot express"
"""The parts by which the sentences of `sim.adaptation.verdict` are recognised."""

Steps = tuple[tuple[str, str], ...]
"""(command, reason) of each step."""


def after_iteration(facts: Facts, result: ResultRecord) -> Steps:
    """The next commands, the likeliest first."""
    go_on = f"adaptsim run-iteration --session {facts.name}"
    use = (f"adaptsim rollout --session {facts.name} --best", "one trial with the best policy so far")
    done, verdict = result.iteration, result.verdict
    if CANNOT_EXPRESS in verdict or verdict.startswith(HOPELESS):
        where = same_lab(facts.task, facts.hw, facts.world, facts.seed)
        tool = (f"adaptsim touch-off {where}", "measures table and tool again")
        camera = (f"adaptsim calibrate check {where}", "has the camera moved?")
        return (camera, tool, use) if facts.calibration else (use,)
    if verdict.startswith(STAYS_LOW):
        return (
            (f"adaptsim lab list --task {facts.task}", "the ranges; to set your own: docs/guide/own-objects.md"),
            use,
        )
    if verdict.startswith((CONVERGED, ENOUGH)):
        return (use, (go_on, "only to know the reward more precisely"))
    if verdict.startswith(NOT_YET) and done >= ENOUGH_ITERATIONS:
        return (use, (go_on, f"{done} iterations are done; more rarely help"))
    return ((go_on, f"iteration {done + 1}"), use)
