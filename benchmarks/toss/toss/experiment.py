"""The method judged on tosses that other people recorded: python -m toss.experiment TOSSES (`make tosses TOSSES=FILE`).

A session sees one half of the recorded tosses, and each of them once; its final policy chooses among the other half.
Each pair of a grid point and a toss is simulated once and kept in the folder `--out`. Stop it at any time: the same
command continues. The last line is one JSON object.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np

from hw.types import Array
from sim.adaptation.judging import assess, final_policy
from sim.adaptation.judging import judge as verdict_of
from sim.adaptation.method import Iteration, Method
from sim.adaptation.methods.adaptsim import AdaptSim
from sim.adaptation.methods.belief import Belief
from sim.adaptation.reality import Simulators
from sim.adaptation.reward_table import RewardTable
from sim.research.benchmark.sessions import Conditions, judge, run_iterations, udr_policies
from sim.research.benchmark.trial_sources import FromRecordings
from sim.research.methods.random_search import RandomSearch
from sim.rollouts.draws import cover
from sim.rollouts.recorded import RecordedTrials
from sim.rollouts.run import Requests, Rollouts, observed
from sim.rollouts.shards import read_rollouts, write_rollouts
from sim.solvers.among import Among
from sim.solvers.grid import PROBES, GridSolver
from sim.solvers.misfit import Misfits
from sim.solvers.solver import policy_for
from sim.storage.files import whole_file
from sim.tasks.solver import SolvedPolicy
from toss import PARAMETERS, TASK, face_on_top
from toss.data import Tosses, read_tosses
from toss.page import write

GRID = 48
"""Points of the grid that fill the ranges."""

BUDGET, PARTICLES, SEEDS, HELD_OUT = 20, 2, 200, 0.5
CONDITIONS = Conditions(BUDGET, PARTICLES)
REFERENCES = "references"
AUTHORS_MU, AUTHORS = 0.15, 8
"""The authors' friction, and how many points of the grid have it; they state no modulus and no dissipation."""

ORDER = 7
"""Seed of the order in which tosses are simulated."""

CONTEXTS = 64
"""Goals over which rewards are averaged in the prospects."""


@dataclass(frozen=True, eq=False)
class Half:
    """One half of the tosses, with the simulator that answers for them."""

    trials: RecordedTrials
    solver: Among
    prospects: RewardTable

    @classmethod
    def of(cls, grid: GridSolver, trials: RecordedTrials) -> Half:
        """The prospects are exact: policies of the grid's points, in simulators at the grid's points."""
        solver = Among(grid, trials.actions)
        contexts = TASK.context.sample(np.random.default_rng(0), CONTEXTS)
        rewards = []
        for policy in solver.policies(grid.points[:, None], np.random.default_rng(0)):
            acts = np.broadcast_to(policy.actions(contexts), (len(grid.points), CONTEXTS, len(TASK.action)))
            rewards.append(solver.expected_rewards(grid.points, contexts, acts, np.random.default_rng(0)))
        return cls(trials, solver, RewardTable(grid.points, grid.points, np.array(rewards)))


def _bo(half: Half) -> Method:
    from sim.research.methods.bo import BayesianOptimisation  # noqa: PLC0415 - torch, an extra

    return BayesianOptimisation(TASK)


def _sysid(half: Half, *, point: bool) -> Method:
    from sim.research.methods.sysid import SysId  # noqa: PLC0415 - torch, an extra

    return SysId(half.solver, ends_only=point, point=point)


METHODS: dict[str, Callable[[Half], Method]] = {
    "adaptsim": lambda half: AdaptSim(Simulators(half.solver, half.prospects)),
    "random": lambda half: RandomSearch(TASK),
    "adaptsim-belief": lambda half: Belief(half.solver, half.prospects),
    "bo": _bo,
    "sysid-bayes": partial(_sysid, point=False),
    "sysid-bayes-point": partial(_sysid, point=True),
}


def points() -> Array:
    """(GRID + AUTHORS, p) the simulated parameters, those with the authors' friction last."""
    theirs = cover(PARAMETERS, AUTHORS, np.random.default_rng(1))
    theirs[:, 0] = AUTHORS_MU
    return np.concatenate([cover(PARAMETERS, GRID, np.random.default_rng(0)), theirs])


def simulated(tosses: Tosses, folder: Path) -> GridSolver:
    """Every toss at every point, from the shards in `folder`; missing ones are simulated."""
    grid = GridSolver(TASK, points(), tosses.actions[:PROBES])
    k, nothing = len(grid.points), np.zeros(0)
    for i, (number, action) in enumerate(zip(tosses.numbers, tosses.actions, strict=True)):
        context = np.tile(np.asarray(TASK.reference_context), (k, 1))
        asked = Requests(grid.points, context, np.tile(action, (k, 1)), np.zeros((k, 0)))
        path = folder / f"toss-{number:04d}.npz"
        found = read_rollouts(path, asked)
        if found is None:
            found = _rolled(asked)
            write_rollouts(path, asked, found)
            _say(f"simulated {i + 1} of {len(tosses.numbers)} tosses")
        grid.remember(action, nothing, found)
    return grid


@dataclass(frozen=True, eq=False)
class Seed:
    """One split of the tosses, with the sessions and policies on it."""

    grid: GridSolver
    trials: RecordedTrials
    number: int

    @cached_property
    def halves(self) -> tuple[Half, Half]:
        """The half for the session, and the one for the scores."""
        shown, held = self.trials.split(HELD_OUT, self.number)
        return Half.of(self.grid, shown), Half.of(self.grid, held)

    def run(self, name: str) -> dict[str, Any]:
        """The results of a method; of the references and the control, for the name `REFERENCES`."""
        session, scores = self.halves
        if name == REFERENCES:
            return self._references(session, scores) | _control(self.grid, self.trials, self.number)
        history = _history(METHODS[name](session), session, scores.trials, self.number)
        final = final_policy(METHODS[name](scores), scores.solver, TASK, history)
        found: dict[str, Any] = {name: self._scored(final)}
        return found | (_judged(METHODS[name](session), session, scores, history) if name == "adaptsim" else {})

    def _references(self, session: Half, scores: Half) -> dict[str, Any]:
        each = [self._scored(policy_for(scores.solver, point[None])) for point in self.grid.points]
        theirs = policy_for(scores.solver, self.grid.points[GRID:])
        place = FromRecordings(session.trials, scores.trials)
        best = judge(TASK, place.best_actions, place, CONDITIONS, self.number).reward
        return {
            "udr": float(np.mean([self._scored(policy) for policy in udr_policies(scores.solver, self.number)])),
            "average_particle": float(np.mean(each[:GRID])),
            "best_of_grid": each[_best_on(session, self.grid.points, self.number)],
            "authors": self._scored(theirs),
            "best_recorded": best,
        }

    def _scored(self, policy: SolvedPolicy) -> float:
        session, scores = self.halves
        return judge(
            TASK, policy.actions, FromRecordings(session.trials, scores.trials), CONDITIONS, self.number
        ).reward


def _control(grid: GridSolver, trials: RecordedTrials, seed: int) -> dict[str, float]:
    """The gain of `adaptsim` over UDR if the recorded outcomes are shuffled: in all tosses, and only in those shown."""
    found = dict[str, float]()
    split = trials.split(HELD_OUT, seed)
    for name, (shown, held) in {
        "permuted": trials.permuted(seed).split(HELD_OUT, seed),
        "permuted_shown": (split[0].permuted(seed), split[1]),
    }.items():
        session, scores, place = Half.of(grid, shown), Half.of(grid, held), FromRecordings(shown, held)
        history = _history(METHODS["adaptsim"](session), session, held, seed)
        policies = [final_policy(METHODS["adaptsim"](scores), scores.solver, TASK, history)]
        earned = [
            float(np.mean([judge(TASK, p.actions, place, CONDITIONS, seed).reward for p in some]))
            for some in (policies, udr_policies(scores.solver, seed))
        ]
        found[name] = earned[0] - earned[1]
    return found


def _history(method: Method, session: Half, held: RecordedTrials, seed: int) -> tuple[Iteration, ...]:
    *_, history = run_iterations(session.solver, method, FromRecordings(session.trials, held), CONDITIONS, seed)
    return history


def _best_on(session: Half, grid: Array, seed: int) -> int:
    """The point of the grid whose policy earns most with all tosses of the session, not only twenty."""
    place = FromRecordings(session.trials, session.trials)
    policies = session.solver.policies(grid[:, None], np.random.default_rng(0))
    return int(np.argmax([judge(TASK, policy.actions, place, CONDITIONS, seed + 10_000).reward for policy in policies]))


def _judged(method: Method, session: Half, scores: Half, history: tuple[Iteration, ...]) -> dict[str, Any]:
    """The verdict, and the held-out errors of prior and posterior."""
    assert isinstance(method, AdaptSim)
    best, ahead = assess(method, TASK, history)
    verdict = verdict_of(TASK, history, Misfits(session.solver), best, ahead)
    weights = method.reality(history).weights
    prior = np.full(len(weights), 1.0 / len(weights))
    truth = np.stack([TASK.end_state(track) for track in scores.trials.tracks])
    _, ends = scores.solver.outcomes(session.prospects.truths[None], scores.trials.actions[:, None], np.zeros(0))
    off_m = np.linalg.norm(ends[0, ..., :2] - truth[:, None, :2], axis=-1)
    shows = face_on_top(ends[0, ..., 2:]) == face_on_top(truth[:, 2:])[:, None]
    found: dict[str, Any] = {"inexpressible": verdict.is_inexpressible, "strange": verdict.strange}
    for name, share in (("prior", prior), ("posterior", weights)):
        found[f"{name}_error_mm"] = 1e3 * float(np.median(off_m @ share))
        found[f"{name}_face"] = float((shows @ share).mean())
    found["posterior"] = [float(v) for v in weights @ TASK.parameters.normalise(session.prospects.truths)]
    return found


def _rolled(asked: Requests) -> Rollouts:
    rows = zip(asked.parameters, asked.context, asked.action, asked.nuisance, strict=True)
    return observed(TASK, [TASK.simulate(*row) for row in rows])


def rows_of(
    grid: GridSolver, trials: RecordedTrials, methods: tuple[str, ...], seeds: int, folder: Path
) -> Iterator[dict[str, Any]]:
    """The results of each seed; every part is kept in a file of its own."""
    for number in range(seeds):
        seed, row = Seed(grid, trials, number), {"seed": number}
        for name in (REFERENCES, *methods):
            path = folder / f"seed-{number:04d}-{name}.json"
            if not path.exists():
                found = json.dumps(seed.run(name))
                with whole_file(path) as temporary:
                    temporary.write_text(found)
            row |= json.loads(path.read_text())
        _say(f"seed {number + 1} of {seeds}: udr {row['udr']:.3f}, " + ", ".join(f"{m} {row[m]:.3f}" for m in methods))
        yield row


def _say(what: str) -> None:
    print(what, file=sys.stderr, flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tosses", type=Path, help="tosses.npz")
    parser.add_argument("--out", type=Path, default=Path("build/tosses"), help="folder of the results")
    parser.add_argument("--seeds", type=int, default=SEEDS)
    parser.add_argument("--limit", type=int, help="use only so many tosses, drawn at random")
    parser.add_argument("--methods", default=",".join(METHODS), help="of " + ", ".join(METHODS))
    parser.add_argument("--page", type=Path, help="write the page of the results here, and its figure beside it")
    asked = parser.parse_args()
    methods = tuple(asked.methods.split(","))
    if unknown := [name for name in methods if name not in METHODS]:
        parser.error(f"--methods {','.join(unknown)}: choose of {', '.join(METHODS)}")
    try:
        tosses = read_tosses(asked.tosses)
    except ValueError as error:
        parser.error(str(error))
    drawn = np.random.default_rng(ORDER).permutation(len(tosses.numbers))[: asked.limit]
    total, tosses = len(tosses.numbers), tosses.some(drawn)
    (asked.out / "table").mkdir(parents=True, exist_ok=True)
    grid = simulated(tosses, asked.out / "table")
    trials = RecordedTrials(TASK, tuple(map(str, tosses.numbers)), None, tosses.actions, tosses.tracks)
    rows = list(rows_of(grid, trials, methods, asked.seeds, asked.out))
    if asked.page is not None:
        held = trials.split(HELD_OUT, 0)[1]
        write(rows, methods, tosses, total, trials.at(held.actions).tolist(), len(grid.points), asked.page)
    mean = partial(_mean, rows)
    print(json.dumps({**{n: mean(n) for n in ("udr", *methods, "best_recorded", "permuted")}, "seeds": len(rows)}))


def _mean(rows: list[dict[str, Any]], name: str) -> float:
    return round(float(np.mean([row[name] for row in rows])), 4)


if __name__ == "__main__":
    main()
