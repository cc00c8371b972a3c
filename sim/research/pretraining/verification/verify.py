"""Verifies a finished pretraining from its folder and true rollouts: the numbers of its report `phase1.md`.

The rollouts are stored in the folder's `proof/`, so that a second or resumed run repeats none.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, field, fields
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from hw.types import Array
from sim.adaptation.checkpoint import CARD, Card, EvaluationReport, read_card
from sim.errors import DatasetError
from sim.research.methods.q_network import QNetwork
from sim.research.methods.q_policy import MemoryName, restore_policy
from sim.research.pretraining.episodes import Episodes
from sim.research.pretraining.logs import wall_times_s
from sim.research.pretraining.meta_training import MetaSettings, gate_visits
from sim.research.pretraining.pipeline import MEMORIES, STAGES, policy_files, read_report, stage_seeds
from sim.research.pretraining.verification.policies import Pairs, PairSettings, compare_policies
from sim.research.pretraining.verification.replays import Replays, replay
from sim.research.pretraining.verification.statistics import wilson
from sim.rollouts.dataset import Dataset, load_dataset
from sim.rollouts.run import Roll, Rollouts, roll_in_parts, run_many
from sim.rollouts.shards import CachedRollouts
from sim.solvers.emulator.network import Emulator
from sim.solvers.emulator.training import EmulatorSettings, held_out_errors, split
from sim.solvers.solver import Solver
from sim.storage.files import load_tensors
from sim.tasks.fingerprint import fingerprint
from sim.tasks.task import Task

AT_ONCE = 128
"""Rollouts simulated and stored together: the most that an interruption costs."""

STREAM = 1000
"""Offset to the pretraining's seed, far from those of its stages."""

BINS = 10

PARTS = ("policies in pairs", "episodes replayed")

Progress = Callable[[str, int, int], None]
S = TypeVar("S", MetaSettings, EmulatorSettings)


@dataclass(frozen=True)
class VerificationSettings:
    """The size of a verification: by default about 5,500 rollouts."""

    pairs: PairSettings = field(default_factory=PairSettings)
    episodes: int = 104  # of one particle each

    def __post_init__(self) -> None:
        if self.pairs.targets > self.pairs.environments:
            raise ValueError(f"{self.pairs.targets} targets of {self.pairs.environments} environments")


@dataclass(frozen=True)
class StageCost:
    """The cost of a stage of the pretraining."""

    stage: str
    simulations: int | None  # None: counted for all stages together
    wall_s: float | None  # None: not measured


@dataclass(frozen=True, eq=False)
class Pretrained:
    """A finished pretraining, read from its folder."""

    task: Task
    folder: Path
    plan: Mapping[str, Any]
    card: Card
    policies: Mapping[MemoryName, Mapping[str, Any]]  # learning curve and gate of each adaptation policy
    networks: Mapping[MemoryName, QNetwork]
    episodes: Episodes
    solver: Solver | None  # None without emulator and exact answers
    emulator: Emulator | None
    dataset: Dataset | None

    @property
    def evaluation(self) -> EvaluationReport:
        """The card's results of the methods on unseen targets. Raises DatasetError if it has none."""
        if self.card.evaluation is None:
            raise DatasetError(f"the checkpoint in {self.folder} was not evaluated: run its command with --evaluate")
        return self.card.evaluation

    @property
    def by_naf(self) -> bool:
        """Whether its task policies are NAF's."""
        return bool(self.plan.get("solver") == "naf" and self.task.exact is None)

    @property
    def wide(self) -> bool:
        """Whether the training targets also lay outside Omega."""
        return bool(self.plan["budget"]["meta"]["targets"] == "wide")


@dataclass(frozen=True, eq=False)
class Reliability:
    """Held-out rollouts by the emulator's probability of success, in bins of a tenth."""

    predicted: Array  # (BINS,) mean probability; nan in an empty bin, like the next three
    observed: Array  # (BINS,) share that succeeded
    low: Array  # (BINS,) of its 95 % interval
    high: Array  # (BINS,)
    count: NDArray[np.int_]  # (BINS,)


@dataclass(frozen=True)
class Errors:
    """Errors on some of the held-out rollouts."""

    rollouts: int
    base_rate: float  # accuracy of guessing the commoner outcome
    accuracy: float
    brier: float
    position_median: float  # of the last observed position, in state units (m)
    position_p90: float


@dataclass(frozen=True, eq=False)
class EmulatorHeldOut:
    """The emulator on its held-out rollouts."""

    trained_on: int
    everywhere: Errors  # over the margin, as the dataset
    inside: Errors | None  # only those inside Omega; None if there are none
    calibration_error: float  # expected, ten bins, everywhere
    reliability: Reliability
    position_errors: Array  # (n,) in state units, everywhere


@dataclass(frozen=True, eq=False)
class Verification:
    """All data of the report."""

    pretrained: Pretrained
    held_out: EmulatorHeldOut | None  # None without an emulator, as are the pairs
    pairs: Pairs | None
    replays: Replays | None
    stages: tuple[StageCost, ...]
    rollouts: int  # number of rollouts behind the report


def is_finished(folder: Path) -> bool:
    """Whether the folder holds everything for `load_pretrained`."""
    needed = (f"checkpoint/{CARD}", "episodes.safetensors", "evaluation.toml")
    return all((folder / name).exists() for name in needed)


def load_pretrained(task: Task, folder: Path) -> Pretrained:
    """Read a pretraining. Raises DatasetError if it is unfinished, or for another task or other ranges."""
    again = f"finish it with `adaptsim pretrain --task {task.name} --out {folder}`"
    if not is_finished(folder):
        raise DatasetError(f"{folder} holds no finished pretraining: {again}")
    plan = read_report(folder / "plan.toml")
    if (plan["task"], plan["fingerprint"]) != (task.name, fingerprint(task)):
        raise DatasetError(
            f"the pretraining in {folder} is of {plan['task']} with ranges {plan['fingerprint']}, wanted {task.name} "
            f"with {fingerprint(task)}: name the task, or the object's file, that it was made for"
        )
    emulator, dataset = None, None
    if (folder / "emulator.safetensors").exists():
        emulator = Emulator(task, load_tensors(folder / "emulator.safetensors"))
        dataset = load_dataset(folder / "dataset", task)
    solver: Solver | None = emulator or (task.exact(task) if task.exact else None)
    files = {memory: policy_files(folder, memory) for memory in MEMORIES}
    files = {memory: both for memory, both in files.items() if all(path.exists() for path in both)}
    return Pretrained(
        task=task,
        folder=folder,
        plan=plan,
        card=read_card(folder / "checkpoint", task.name),
        policies={memory: read_report(report) for memory, (_, report) in files.items()},
        networks={m: restore_policy(task, m, load_tensors(weights)) for m, (weights, _) in files.items()},
        episodes=Episodes(**load_tensors(folder / "episodes.safetensors")),
        solver=solver,
        emulator=emulator,
        dataset=dataset,
    )


def verify(made: Pretrained, settings: VerificationSettings, executor: Executor, progress: Progress) -> Verification:
    """Simulate the missing rollouts and summarise. The same folder gives the same numbers."""
    draws = np.random.SeedSequence(int(made.plan["seed"]), spawn_key=(STREAM,)).spawn(2)
    rngs = [np.random.default_rng(s) for s in draws]
    judged = _held_out(made)  # first, because it rejects parts that do not belong together
    pairs = replays = None
    counts = (settings.pairs.simulations, _replayed(made, settings))
    rolls = [_roll(made, executor, partial(progress, part), n) for part, n in zip(PARTS, counts, strict=True)]
    if made.emulator is not None and made.solver is not None:
        pairs = compare_policies(made.solver, rolls[0], settings.pairs, rngs[0])
    if made.solver is not None:
        replays = replay(made.solver, made.emulator, made.networks, made.episodes, settings.episodes, rolls[1], rngs[1])
    return Verification(
        pretrained=made,
        held_out=judged,
        pairs=pairs,
        replays=replays,
        stages=stage_costs(made),
        rollouts=(counts[0] if pairs else 0) + (counts[1] if replays else 0),
    )


def stage_costs(made: Pretrained) -> tuple[StageCost, ...]:
    """Simulations and wall time of each stage."""
    task, measured = made.task, wall_times_s(made.folder)
    meta = _known(MetaSettings, made.plan["budget"]["meta"])
    visits = len(MEMORIES) * (meta.visits(task) + gate_visits(task))
    episodes = 0 if made.emulator else visits * task.adaptation.trials_per_iteration
    drawn = len(made.dataset) if made.dataset is not None else 0
    counted = made.card.simulations
    evaluated = counted - drawn - episodes
    simulations = dict(zip(STAGES, (drawn, 0, 0, episodes, max(0, evaluated), 0), strict=True))
    if made.by_naf:  # NAF simulates for every policy, in every stage
        together = StageCost("all stages, NAF's own rollouts included", counted, None)
        return (*(StageCost(stage, None, measured[stage]) for stage in STAGES if stage in measured), together)
    return tuple(
        StageCost(stage, simulations[stage], measured.get(stage))
        for stage in STAGES
        if stage in measured or simulations[stage]
    )


def _held_out(made: Pretrained) -> EmulatorHeldOut | None:
    if made.emulator is None or made.dataset is None:
        return None
    seeds = stage_seeds(int(made.plan["seed"]))
    settings = _known(EmulatorSettings, made.plan["budget"]["emulator"])
    return held_out(made.emulator, made.dataset, seeds[1], settings, read_report(made.folder / "emulator.toml"))


def held_out(
    emulator: Emulator, dataset: Dataset, seed: int, settings: EmulatorSettings, stored: Mapping[str, Any]
) -> EmulatorHeldOut:
    """Judge the emulator again on the rollouts behind its report `stored`.

    Raises DatasetError if the figures differ from the report: then emulator, dataset and report do not belong together.
    """
    task, (_, rows, _) = emulator.task, split(dataset, np.random.default_rng(seed), settings)
    requests, true = dataset.select(rows)
    errors = held_out_errors(emulator, requests, true)
    everywhere = _errors(errors, true)
    if abs(everywhere.brier - float(stored["brier"])) > 1e-3:
        raise DatasetError(
            f"on the held-out rollouts the emulator has a Brier score of {everywhere.brier:.4f}, its report says "
            f"{float(stored['brier']):.4f}: dataset, emulator and report do not come from the same pretraining. Remove "
            "emulator.safetensors and what follows, and run the same `adaptsim pretrain` again"
        )
    within = rows[[task.parameters.contains(parameters) for parameters in requests.parameters]]
    inside = None
    if len(within):
        asked, some = dataset.select(within)
        inside = _errors(held_out_errors(emulator, asked, some), some)
    said = emulator.predict(requests.parameters, requests.action, requests.nuisance).success
    return EmulatorHeldOut(
        trained_on=int(stored["rollouts"]),
        everywhere=everywhere,
        inside=inside,
        calibration_error=float(stored["calibration_error"]),
        reliability=reliability_bins(said, true.succeeded),
        position_errors=errors["position_error_median"],
    )


def reliability_bins(probability: Array, succeeded: NDArray[np.bool_]) -> Reliability:
    """Predicted against observed successes of (N,) rollouts."""
    bins = np.minimum((probability * BINS).astype(int), BINS - 1)
    count = np.bincount(bins, minlength=BINS)
    n = np.where(count > 0, count, np.nan)
    hits = np.bincount(bins, weights=succeeded, minlength=BINS).astype(int)
    low, high = wilson(hits, count)
    return Reliability(np.bincount(bins, weights=probability, minlength=BINS) / n, hits / n, low, high, count)


def _errors(errors: Mapping[str, Array], true: Rollouts) -> Errors:
    share, apart = float(true.succeeded.mean()), errors["position_error_median"]
    quantiles = np.quantile(apart, [0.5, 0.9]) if len(apart) else (np.nan, np.nan)
    return Errors(
        rollouts=len(true),
        base_rate=max(share, 1.0 - share),
        accuracy=float(errors["accuracy"].mean()),
        brier=float(errors["brier"].mean()),
        position_median=float(quantiles[0]),
        position_p90=float(quantiles[1]),
    )


def _replayed(made: Pretrained, settings: VerificationSettings) -> int:
    targets, particles, visits = made.episodes.rewards.shape
    wanted = min(targets, -(-settings.episodes // particles))
    times = 1 if made.emulator is None else 2
    return int(times * wanted * particles * visits * made.task.adaptation.trials_per_iteration)


def _roll(made: Pretrained, executor: Executor, progress: Callable[[int, int], None], total: int) -> Roll:
    """A source of true rollouts, stored in the folder part by part, with progress."""
    one: Roll = partial(run_many, made.task, executor=executor)
    kept: Roll = one if made.task.exact else CachedRollouts(made.task, made.folder / "proof", executor)
    return roll_in_parts(kept, AT_ONCE, total, progress)


def _known(kind: type[S], planned: Mapping[str, Any]) -> S:
    """The planned settings, restricted to those of this version."""
    names = {f.name for f in fields(kind)}
    return kind(**{name: value for name, value in planned.items() if name in names})
