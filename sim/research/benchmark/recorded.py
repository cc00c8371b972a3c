"""Methods compared on recorded trials: sessions take one part of them, and scores come from the part held out.

A control runs the default method on trials whose outcomes are shuffled. There nothing can be gained: `permuted` must
earn what `permuted-udr` earns.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace

from sim.adaptation.checkpoint import Checkpoint
from sim.adaptation.judging import final_policy
from sim.adaptation.methods import make_method
from sim.research.benchmark.jobs import BEST_ACTION, UDR, Row, simulations
from sim.research.benchmark.sessions import Commands, Conditions, Judged, judge, mean_of, run_iterations, udr_policies
from sim.research.benchmark.trial_sources import FromRecordings
from sim.rollouts.recorded import RecordedTrials
from sim.solvers.candidates import among

PERMUTED, PERMUTED_UDR = "permuted", "permuted-udr"
CONTROLS = (PERMUTED, PERMUTED_UDR)
"""Of the default method and of UDR, with the outcomes of the trials shuffled."""

DEFAULT = "adaptsim"


@dataclass(frozen=True, eq=False)
class RecordedJob:
    """One method on one split of recorded trials. It runs in this process."""

    checkpoint: Checkpoint
    trials: RecordedTrials
    answers: str  # digest of the trials
    target: str  # name of their folder
    held_out: float
    method: str
    seed: int
    conditions: Conditions
    set: str = field(default="recorded")


def run_recorded(job: RecordedJob) -> Row:
    """Run the session and judge its policies by the trials held out. Raises SimError."""
    began, task, seed = time.perf_counter(), job.trials.task, job.seed
    trials = job.trials.permuted(seed) if job.method in CONTROLS else job.trials
    shown, held = trials.split(job.held_out, seed)
    place = FromRecordings(shown, held)
    session, scores = (replace(job.checkpoint, solver=among(job.checkpoint.solver, h.actions)) for h in (shown, held))

    def judged(act: Commands) -> Judged:
        return judge(task, act, place, job.conditions, seed)

    each, name = job.conditions.particles * task.adaptation.trials_per_iteration, job.method
    if name in (UDR, PERMUTED_UDR):
        each, curve = 0, [mean_of([judged(policy.actions) for policy in udr_policies(scores.solver, seed)])]
    elif name == BEST_ACTION:
        each, curve = 0, [judged(place.best_actions)]
    else:
        method, last = (make_method(DEFAULT if name == PERMUTED else name, task, one) for one in (session, scores))
        histories = run_iterations(session.solver, method, place, job.conditions, seed)
        curve = [judged(final_policy(last, scores.solver, task, history).actions) for history in histories]
    return Row(
        task=task.name,
        set=job.set,
        target=job.target,
        method=name,
        seed=seed,
        reward=curve[-1].reward,
        ci95=curve[-1].ci95,
        real_trials=each * len(curve),
        simulations=simulations(name, job.checkpoint),
        wall_s=time.perf_counter() - began,
        curve=tuple((each * (k + 1), judged.reward) for k, judged in enumerate(curve)),
        shown=None,
    )
