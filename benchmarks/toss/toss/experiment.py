"""The method tested on tosses that other people recorded: python -m toss.experiment TOSSES (`make tosses TOSSES=FILE`).

A session sees one half of the recorded tosses, and each of them once; its final policy chooses among the other half.
Each pair of a grid point and a toss is simulated once and kept in the folder `--out`. Stop it at any time: the same
command continues. The last line is one JSON object.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hw.types import Array
from sim.adaptation.judging import Misfits, assess, final_policy, verdict_of
from sim.adaptation.method import Iteration, Method
from sim.adaptation.methods.adaptsim import AdaptSim
from sim.adaptation.reward_table import RewardTable
from sim.adaptation.simulators import Simulators
from sim.research.benchmark.sessions import Conditions, estimated_reward, judged_contexts, run_iterations, udr_policies
from sim.research.benchmark.trial_sources import FromRecordings
from sim.research.methods.search import RandomSearch
from sim.rollouts.draws import cover
from sim.rollouts.recorded import RecordedTrials
from sim.rollouts.run import Requests, observed
from sim.rollouts.shards import read_rollouts, write_rollouts
from sim.solvers.candidates import ListedActionSolver
from sim.solvers.grid import PROBES, GridSolver
from sim.solvers.solver import policy_for
from sim.storage.files import whole_file
from sim.tasks.task import SolvedPolicy
from sim.types import PredictedOutcomes
from toss import PARAMETERS, TASK, face_on_top
from toss.data import Tosses, read_tosses
from toss.page import write

GRID = 48
"""Points of the grid that fill the ranges."""

AUTHORS_MU, AUTHORS = 0.15, 8
"""The authors' friction, and how many points of the grid have it; they state no modulus and no dissipation."""

CONDITIONS, SEEDS, HELD_OUT = Conditions(budget=20, particles=2), 200, 0.5
REFERENCES = "references"

ORDER = 7
"""Seed of the order in which tosses are simulated."""

CONTEXTS = 64
"""Goals over which rewards are averaged in the reward table."""


@dataclass(frozen=True, eq=False)
class Half:
    """One half of the tosses, with the simulator that predicts them."""

    grid: GridSolver
    trials: RecordedTrials

    @cached_property
    def solver(self) -> ListedActionSolver:
        """It knows only these tosses."""
        return ListedActionSolver(self.grid.task, self.grid, self.trials.actions)

    @cached_property
    def reward_table(self) -> RewardTable:
        """Exact: policies of the grid's points, in simulators at the grid's points."""
        contexts = TASK.context.sample(np.random.default_rng(0), CONTEXTS)
        predicted = self._predicted(contexts)
        chosen = _best(predicted)[:, :, None]
        rewards = np.take_along_axis(predicted, chosen, axis=1).mean(axis=0)
        return RewardTable(self.grid.points, self.grid.points, rewards)

    def earned_by_points(self, seed: int) -> Array:
        """(K,) rewards of the policies of the grid's points with the recordings of this half, averaged over goals."""
        contexts = judged_contexts(TASK, CONDITIONS, seed)
        every = range(len(self.trials))
        real = np.array([self.trials.rewards(every, np.tile(context, (len(every), 1))) for context in contexts])
        return np.asarray(np.take_along_axis(real, _best(self._predicted(contexts)), axis=1).mean(axis=0))

    def _predicted(self, contexts: Array) -> Array:
        """(G, A, K) rewards of every toss at every point of the grid."""
        return np.stack([TASK.expected_reward(self.outcomes, context) for context in contexts])

    @cached_property
    def outcomes(self) -> PredictedOutcomes:
        """The outcomes (A, K) of every toss at every point of the grid."""
        points, contexts = self.grid.points[None], self.grid.contexts[:1]
        return self.solver.outcomes(points, self.trials.actions[:, None], np.zeros(0), contexts).mean_of_ensemble


@dataclass(frozen=True, eq=False)
class Split:
    """The tosses shown to a session, and those held out for the scores."""

    session: Half
    scores: Half
    seed: int

    @classmethod
    def of(cls, grid: GridSolver, parts: tuple[RecordedTrials, RecordedTrials], seed: int) -> Split:
        return cls(Half(grid, parts[0]), Half(grid, parts[1]), seed)

    def history(self, method: Method) -> tuple[Iteration, ...]:
        """The whole session of a method."""
        place = FromRecordings(self.session.trials, self.scores.trials)
        *_, history = run_iterations(self.session.solver, method, place, CONDITIONS, self.seed)
        return history

    def final(self, name: str, history: tuple[Iteration, ...]) -> float:
        """The reward of the final policy after this session."""
        return self.scored(final_policy(METHODS[name](self.scores), self.scores.solver, TASK, history))

    def udr(self) -> float:
        """The mean reward of policies for all parameters."""
        return float(np.mean([self.scored(policy) for policy in udr_policies(self.scores.solver, self.seed)]))

    def scored(self, policy: SolvedPolicy) -> float:
        """The reward of a policy with the tosses held out."""
        place = FromRecordings(self.session.trials, self.scores.trials)
        return estimated_reward(TASK, policy.actions, place, CONDITIONS, self.seed).mean

    @property
    def best_recorded(self) -> float:
        """The reward of the best tosses held out, in hindsight."""
        place = FromRecordings(self.session.trials, self.scores.trials)
        return estimated_reward(TASK, place.best_actions, place, CONDITIONS, self.seed).mean


def _bo(half: Half) -> Method:
    from sim.research.methods.search import BayesianOptimisation  # noqa: PLC0415 - torch, an extra

    return BayesianOptimisation(TASK)


def _sysid(half: Half, *, point: bool) -> Method:
    from sim.research.methods.sysid import SysId  # noqa: PLC0415 - torch, an extra

    return SysId(half.solver, ends_only=point, point=point)


METHODS: dict[str, Callable[[Half], Method]] = {
    "adaptsim": lambda half: AdaptSim(Simulators(half.solver, half.reward_table)),
    "random": lambda half: RandomSearch(TASK),
    "bo": _bo,
    "sysid-bayes": partial(_sysid, point=False),
    "sysid-bayes-point": partial(_sysid, point=True),
}


def points() -> Array:
    """(GRID + AUTHORS, p) the simulated parameters, those with the authors' friction last."""
    theirs = cover(PARAMETERS, AUTHORS, np.random.default_rng(1))
    theirs[:, 0] = AUTHORS_MU
    return np.concatenate([cover(PARAMETERS, GRID, np.random.default_rng(0)), theirs])


def simulated(tosses: RecordedTrials, folder: Path) -> GridSolver:
    """Every toss at every point, from the shards in `folder`; missing ones are simulated."""
    simulators, nothing = points(), np.zeros(0)
    k = len(simulators)
    context = np.tile(np.asarray(TASK.reference_context), (k, 1))
    grid = GridSolver(TASK, simulators, context, tosses.actions[:PROBES], np.zeros((1, 0)))
    for i, (name, action) in enumerate(zip(tosses.names, tosses.actions, strict=True)):
        asked = Requests(grid.points, context, np.tile(action, (k, 1)), np.zeros((k, 0)))
        path = folder / f"toss-{int(name):04d}.npz"
        rollouts = read_rollouts(path, asked)
        if rollouts is None:
            rollouts = observed(TASK, [TASK.simulate(point, context[0], action, nothing) for point in grid.points])
            write_rollouts(path, asked, rollouts)
            _say(f"simulated {i + 1} of {len(tosses)} tosses")
        grid.remember(action, nothing, rollouts)
    return grid


def results(name: str, grid: GridSolver, trials: RecordedTrials, seed: int) -> dict[str, Any]:
    """The results of a method with one seed; of the references and the controls, for the name `REFERENCES`."""
    split = Split.of(grid, trials.split(HELD_OUT, seed), seed)
    if name == REFERENCES:
        return _references(split) | _controls(grid, trials, seed)
    method = METHODS[name](split.session)
    history = split.history(method)
    row: dict[str, Any] = {name: split.final(name, history)}
    return row | (_judged(method, split, history) if isinstance(method, AdaptSim) else {})


def _references(split: Split) -> dict[str, Any]:
    each = split.scores.earned_by_points(split.seed)
    shown = split.session.earned_by_points(split.seed + 10_000)
    return {
        "udr": split.udr(),
        "average_particle": float(each[:GRID].mean()),
        "best_of_grid": float(each[shown.argmax()]),
        "authors": split.scored(policy_for(split.scores.solver, split.scores.grid.points[GRID:])),
        "best_recorded": split.best_recorded,
    }


def _controls(grid: GridSolver, trials: RecordedTrials, seed: int) -> dict[str, float]:
    """The gain of `adaptsim` over UDR if the recorded outcomes are shuffled: in all tosses, and only in those shown."""
    shown, held = trials.split(HELD_OUT, seed)
    row = dict[str, float]()
    for name, parts in {
        "permuted": trials.permuted(seed).split(HELD_OUT, seed),
        "permuted_shown": (shown.permuted(seed), held),
    }.items():
        split = Split.of(grid, parts, seed)
        history = split.history(METHODS["adaptsim"](split.session))
        row[name] = split.final("adaptsim", history) - split.udr()
    return row


def _judged(method: AdaptSim, split: Split, history: tuple[Iteration, ...]) -> dict[str, Any]:
    """The verdict, and the held-out errors of prior and posterior."""
    best, forecast = assess(method, TASK, history)
    verdict = verdict_of(TASK, history, Misfits(split.session.solver), best, forecast)
    weights = method.outcome_posterior(history).weights
    truth = np.stack([TASK.end_state(track) for track in split.scores.trials.tracks])
    ends = split.scores.outcomes.end_state
    off_m = np.linalg.norm(ends[..., :2] - truth[:, None, :2], axis=-1)
    shows = face_on_top(ends[..., 2:]) == face_on_top(truth[:, 2:])[:, None]
    row: dict[str, Any] = {"inexpressible": verdict.is_inexpressible, "strange": verdict.strange}
    for name, share in (("prior", np.full(len(weights), 1.0 / len(weights))), ("posterior", weights)):
        row[f"{name}_error_mm"] = 1e3 * float(np.median(off_m @ share))
        row[f"{name}_face"] = float((shows @ share).mean())
    row["posterior"] = [float(v) for v in weights @ TASK.parameters.normalise(split.session.grid.points)]
    return row


def rows_of(
    grid: GridSolver, trials: RecordedTrials, methods: tuple[str, ...], seeds: int, folder: Path
) -> Iterator[dict[str, Any]]:
    """The results of each seed; every part is kept in a file of its own."""
    for seed in range(seeds):
        row: dict[str, Any] = {"seed": seed}
        for name in (REFERENCES, *methods):
            path = folder / f"seed-{seed:04d}-{name}.json"
            row |= stored(path, partial(results, name, grid, trials, seed))
        _say(f"seed {seed + 1} of {seeds}: udr {row['udr']:.3f}, " + ", ".join(f"{m} {row[m]:.3f}" for m in methods))
        yield row


def stored(path: Path, compute: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """The content of `path`; computed and written if it is missing."""
    if not path.exists():
        row = json.dumps(compute())
        with whole_file(path) as temporary:
            temporary.write_text(row)
    content: dict[str, Any] = json.loads(path.read_text())
    return content


def prepared(path: Path, out: Path) -> tuple[Tosses, GridSolver, Path]:
    """The tosses, the simulator's answers to them, and the folder of their results in `out`.

    Raises ValueError for a file that holds no tosses.
    """
    tosses = read_tosses(path)
    tosses = tosses.some(np.random.default_rng(ORDER).permutation(len(tosses.trials)))
    (out / "table").mkdir(parents=True, exist_ok=True)
    grid = simulated(tosses.trials, out / "table")
    folder = out / hashlib.sha256(tosses.trials.actions.tobytes() + grid.points.tobytes()).hexdigest()[:12]
    folder.mkdir(exist_ok=True)
    return tosses, grid, folder


def _best(predicted: Array) -> NDArray[np.intp]:
    """(G, A, K) rewards -> (G, K) the toss that the policy of each point chooses."""
    return np.asarray(predicted.round(9).argmax(axis=1))


def _say(what: str) -> None:
    print(what, file=sys.stderr, flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tosses", type=Path, help="tosses.npz")
    parser.add_argument("--out", type=Path, default=Path("build/tosses"), help="folder of the results")
    parser.add_argument("--seeds", type=int, default=SEEDS)
    parser.add_argument("--page", type=Path, help="write the page of the results here, and its figure beside it")
    asked = parser.parse_args()
    methods = tuple(METHODS)
    try:
        tosses, grid, folder = prepared(asked.tosses, asked.out)
    except ValueError as error:
        parser.error(str(error))
    trials = tosses.trials
    rows = list(rows_of(grid, trials, methods, asked.seeds, folder))
    if asked.page is not None:
        held = trials.split(HELD_OUT, 0)[1]
        write(rows, methods, tosses, trials.at(held.actions).tolist(), grid, asked.page)
    names = ("udr", *methods, "best_recorded", "permuted")
    means = {name: round(float(np.mean([row[name] for row in rows])), 4) for name in names}
    print(json.dumps({**means, "seeds": len(rows)}))


if __name__ == "__main__":
    main()
