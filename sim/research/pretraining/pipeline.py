"""Phase 1: dataset, emulator, reward table, if wanted policies and evaluation. An interrupted stage can be resumed.

A task with an exact solver needs neither dataset nor emulator, and its rollouts are too cheap to store.

The folder holds `plan.toml` (the settings), `dataset/`, `emulator.safetensors` (or `naf.toml`), `rollouts/` (of the
evaluation, and of NAF's episodes, never simulated twice), `policy-iteration.safetensors`, `policy-history.safetensors`
and `policy-state.safetensors` (adaptation policies, by their memory), each with its learning curve (CSV, and TOML with
the learning gate), `episodes.safetensors` (of the first), `prospects.safetensors` (rewards of E for many possible
truths), the report of each stage, `timings.toml` (wall times), and `checkpoint/`. Existing parts are not made again.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from dataclasses import asdict, dataclass, fields
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from hw.types import Array
from sim.adaptation.card import CARD
from sim.adaptation.checkpoint import save_checkpoint
from sim.adaptation.method import Method
from sim.adaptation.methods.belief import AdaptSimBelief
from sim.adaptation.reward_table import RewardTable, RewardTableSettings, restore_reward_table, tabulate_rewards
from sim.research.methods.q_network import QNetwork
from sim.research.methods.q_policy import MemoryName, QPolicy, restore_policy, tensors_of
from sim.research.methods.search import RandomSearch
from sim.research.naf.memory import NafMemory
from sim.research.naf.solver import NafSolver, measure_misfit_limit, naf_facts, rules_of
from sim.research.pretraining.budget import EVERYTHING, MEMORIES, NETWORKS, OptionalStages, PretrainBudget
from sim.research.pretraining.dataset_share import STAGES, agree_on_plan, denser, read_report, stage_seeds
from sim.research.pretraining.episodes import Acting, EmulatedRolls, Episodes, Simulator, SolverActing, fill_library
from sim.research.pretraining.evaluation import evaluate
from sim.research.pretraining.grid_stage import grid_rollouts, grid_tensors, trained
from sim.research.pretraining.growth import GROWN, enough_rollouts
from sim.research.pretraining.logs import StageTimer, curve_file
from sim.research.pretraining.meta_training import CURVE, Gate, MetaSettings, learning_gate, train_adaptation
from sim.research.pretraining.worth import measured_worth
from sim.rollouts.cost import measured_cost
from sim.rollouts.dataset import build_dataset
from sim.rollouts.run import Roll, StageProgress, run_many
from sim.rollouts.shards import CachedRollouts
from sim.rollouts.soundness import require_sound
from sim.solvers.emulator.network import Emulator
from sim.solvers.emulator.training import reward_error, split, train_emulator
from sim.storage.files import load_tensors, save_tensors, write_toml
from sim.tasks.library import FOLDER as POLICIES
from sim.tasks.library import digests_of, library_of
from sim.tasks.task import Solver, Task

BELIEF, RANDOM = "adaptsim-belief", "random"
"""The methods in the evaluation, by their names in `sim.adaptation.methods.METHODS`."""

WORTH = "worth of the result"

EXACT = "dataset and emulator: not needed, this task is solved exactly"
"""The file that replaces the first two stages with NAF."""


@dataclass(frozen=True, eq=False)
class _Means:
    """The parts for training and judging the adaptation policy."""

    task: Task
    new_solver: Callable[[], Solver]
    """Makes a solver without stored policies, so that a stage does not depend on earlier stages in this process."""
    emulator: Emulator | None  # for the checkpoint
    roll: Roll
    simulated: Callable[[], int]  # number of rollouts so far
    facts: dict[str, Any]  # for the card
    reward_error: Callable[[], float | None] = lambda: None  # of the emulator, on unseen rollouts

    @property
    def memories(self) -> tuple[MemoryName, ...]:
        """The memories of the adaptation policies: only the paper's where every trial is simulated."""
        return MEMORIES if self.emulator or self.task.exact else MEMORIES[:1]


def pretrain(
    task: Task,
    folder: Path,
    budget: PretrainBudget,
    seed: int,
    executor: Executor,
    progress: StageProgress,
    solver: str = "emulator",
    stages: OptionalStages = EVERYTHING,
) -> Path:
    """Make the checkpoint of `task` in `folder` and return its path, for `load_checkpoint`.

    Without the `stages` it has only the parts for inference. Raises DatasetError if the folder holds another
    plan, RolloutError if the first rollouts show that the task is not sound. It may be stopped at any time; the same
    call continues.
    """
    if task.training is None:
        require_sound(task, np.random.default_rng(seed))
    agree_on_plan(task, folder, budget, seed, solver)
    draws, progress = stage_seeds(seed), StageTimer(folder, progress)
    facts: dict[str, Any] = {"seed": seed}
    if task.training is not None:
        task = trained(task, folder, draws[0], executor, progress)
        library = library_of(task)
        assert library is not None
        facts["policies"] = digests_of(library.members)
        require_sound(task, np.random.default_rng(seed))
    further: dict[str, Array] = {}
    if task.exact:
        exact = task.exact(task)
        further = grid_tensors(folder, exact, executor, progress)
        progress(EXACT, 1, 1)
        means = _exact(task, exact, budget, executor, stages)
    elif solver == "naf":
        progress("dataset and emulator: not needed, NAF asks the simulator", 1, 1)
        means = _by_naf(task, folder, budget, draws[0], executor)
    else:
        means = _learnt(task, folder, budget, (draws[0], draws[1]), executor, progress)
    # None with NAF: without an emulator each entry would cost a simulation.
    table = None
    if task.exact or means.emulator:
        table = _reward_table(folder, means, budget.prospects, draws[2], progress)
    if table is not None:
        facts["worth"] = _worth(folder, means, table, draws[2], progress)
    networks: dict[MemoryName, QNetwork] = {}
    if stages.policies or table is None or policy_files(folder, MEMORIES[0])[1].exists():
        networks = _policies(folder, means, budget.meta, draws[2], progress)
        facts["policy"] = {memory: read_report(policy_files(folder, memory)[1]) for memory in networks}
    if stages.evaluation or (folder / "evaluation.toml").exists():
        results = _evaluation(folder, means, networks, table, budget, draws[3], progress, anew=stages.evaluation)
        facts["evaluation"] = results
    path = folder / "checkpoint"
    stored = read_report(path / CARD) if (path / CARD).exists() else {}
    if any(stored.get(key) != value for key, value in facts.items()):
        facts["simulations"] = means.simulated() + grid_rollouts(further)
        if library_of(task) is not None:
            shutil.copytree(folder / POLICIES, path / POLICIES, dirs_exist_ok=True)
        save_checkpoint(task, path, means.emulator, tensors_of(networks) | further, {**means.facts, **facts}, table)
    progress(STAGES[5], 1, 1)
    return path


def _exact(task: Task, solver: Solver, budget: PretrainBudget, executor: Executor, stages: OptionalStages) -> _Means:
    facts = {"budget": {"meta": asdict(budget.meta), "evaluation": asdict(budget.evaluation)}}
    roll = partial(run_many, task, executor=executor)
    return _Means(task, lambda: solver, None, roll, partial(budget.uncached, task, stages), facts)


def _by_naf(task: Task, folder: Path, budget: PretrainBudget, seed: int, executor: Executor) -> _Means:
    """The paper's solver, on true rollouts only."""
    roll = CachedRollouts(task, folder / "rollouts", executor)
    rules, path = rules_of(task, budget.naf_scale), folder / "naf.toml"

    def new_solver() -> NafSolver:
        return NafSolver(task, roll, rules, NafMemory(task), float(read_report(path)["misfit_limit"]))

    if not path.exists():
        unlimited = NafSolver(task, roll, rules, NafMemory(task))
        write_toml(path, {"misfit_limit": measure_misfit_limit(unlimited, np.random.default_rng(seed))})
    facts = {"budget": asdict(budget), **naf_facts(new_solver())}
    return _Means(task, new_solver, None, roll, roll.count, facts)


def _learnt(
    task: Task,
    folder: Path,
    budget: PretrainBudget,
    seeds: tuple[int, int],
    executor: Executor,
    progress: StageProgress,
) -> _Means:
    cost, size = measured_cost(task, seeds[0]), budget.rollouts
    adaptive = denser(task, budget, seeds[1])
    progress(cost.in_words(budget.rollouts + budget.denser), 1, 1)
    if cost.is_slow or (folder / "dataset" / GROWN).exists():
        size = enough_rollouts(
            task, folder / "dataset", size, seeds[0], budget.emulator, executor, lambda i, n: progress(STAGES[0], i, n)
        )
        adaptive = adaptive if size == budget.rollouts else None
    dataset = build_dataset(
        task, folder / "dataset", size, seeds[0], executor, lambda i, n: progress(STAGES[0], i, n), adaptive
    )
    path, report = folder / "emulator.safetensors", folder / "emulator.toml"
    if not (path.exists() and report.exists()):
        emulator, held_out = train_emulator(
            task, dataset, seeds[1], budget.emulator, lambda i, n: progress(STAGES[1], i, n)
        )
        save_tensors(path, emulator.tensors)
        write_toml(report, asdict(held_out))
    progress(STAGES[1], 1, 1)
    emulator = Emulator(task, load_tensors(path))
    facts = {"data": dataset.identity, "budget": asdict(budget), "emulator": read_report(report)}
    roll = CachedRollouts(task, folder / "rollouts", executor)

    def unseen_error() -> float:
        _, unseen, _ = split(dataset, np.random.default_rng(seeds[1]), budget.emulator)
        return reward_error(emulator, *dataset.select(unseen))

    return _Means(task, lambda: emulator, emulator, roll, lambda: len(dataset) + roll.count(), facts, unseen_error)


def _policies(
    folder: Path, means: _Means, settings: MetaSettings, seed: int, progress: StageProgress
) -> dict[MemoryName, QNetwork]:
    """An adaptation policy with each memory."""
    task, episodes = means.task, folder / "episodes.safetensors"
    missing = [m for m in means.memories if not all(path.exists() for path in policy_files(folder, m))]
    if missing:
        acting = _acting(means, settings, seed)
        for memory in missing:
            of_training, of_trials = np.random.SeedSequence(seed, spawn_key=(MEMORIES.index(memory),)).generate_state(2)
            simulator = _simulator(means, acting, int(of_trials))
            log = curve_file(folder / f"policy-{memory}.csv", CURVE)
            network, curve, played = train_adaptation(
                simulator, settings, int(of_training), memory, _after(memory, means, settings, progress), log
            )
            gate = learning_gate(simulator, network, memory, int(of_training) + 1, settings.targets)
            weights, report = policy_files(folder, memory)
            if memory == MEMORIES[0]:
                save_tensors(episodes, {f.name: getattr(played, f.name) for f in fields(Episodes)})
            save_tensors(weights, network.tensors)
            write_toml(report, _summary(curve, gate))
    progress(STAGES[3], 1, 1)
    return {m: restore_policy(task, m, load_tensors(policy_files(folder, m)[0])) for m in means.memories}


def _after(
    memory: MemoryName, means: _Means, settings: MetaSettings, progress: StageProgress
) -> Callable[[int, int], None]:
    """The progress of all trainings, from the progress of one training."""
    before, total = (settings.episodes * n for n in (means.memories.index(memory), len(means.memories)))
    return lambda i, _: progress(STAGES[3], before + i, total)


def policy_files(folder: Path, memory: MemoryName) -> tuple[Path, Path]:
    """Weights, and learning curve with gate."""
    return folder / f"policy-{memory}.safetensors", folder / f"policy-{memory}.toml"


def _acting(means: _Means, settings: MetaSettings, seed: int) -> Acting:
    """The task policies of the episodes. NAF reuses its policies by its own rules, and exact policies cost nothing."""
    solver = means.new_solver()
    return fill_library(solver, seed, settings.library) if means.emulator else SolverActing(solver)


def _simulator(means: _Means, acting: Acting, seed: int) -> Simulator:
    """The world of the episodes: the emulator's ensemble where there is one."""
    roll = EmulatedRolls(means.emulator, np.random.default_rng(seed)) if means.emulator else means.roll
    return Simulator(means.new_solver(), acting, roll)


def _reward_table(
    folder: Path, means: _Means, settings: RewardTableSettings, seed: int, progress: StageProgress
) -> RewardTable:
    path = folder / "prospects.safetensors"
    if not path.exists():
        table = tabulate_rewards(means.new_solver(), seed, settings, lambda i, n: progress(STAGES[2], i, n))
        save_tensors(path, table.tensors)
    progress(STAGES[2], 1, 1)
    return restore_reward_table(means.task, load_tensors(path))


def _worth(folder: Path, means: _Means, table: RewardTable, seed: int, progress: StageProgress) -> dict[str, Any]:
    path = folder / "worth.toml"
    if not path.exists():
        progress(WORTH, 0, 1)
        worth = asdict(measured_worth(means.new_solver(), table, means.reward_error(), seed))
        write_toml(path, {key: value for key, value in worth.items() if value is not None})
    progress(WORTH, 1, 1)
    return read_report(path)


def _evaluation(
    folder: Path,
    means: _Means,
    networks: Mapping[MemoryName, QNetwork],
    table: RewardTable | None,
    budget: PretrainBudget,
    seed: int,
    progress: StageProgress,
    *,
    anew: bool,
) -> dict[str, Any]:
    """The stored or new evaluation; `anew` repeats it if policies were added after it."""
    path, task = folder / "evaluation.toml", means.task
    if not path.exists() or (anew and networks and not _has_policies(read_report(path))):
        methods: dict[str, Method] = {
            name: QPolicy(task, networks[memory], memory) for memory, name in NETWORKS.items() if memory in networks
        }
        methods[RANDOM] = RandomSearch(task)
        if table is not None:
            methods[BELIEF] = AdaptSimBelief(means.new_solver(), table)
        results = evaluate(
            means.new_solver(), methods, means.roll, budget.evaluation, seed, lambda i, n: progress(STAGES[4], i, n)
        )
        write_toml(path, asdict(results))
    progress(STAGES[4], 1, 1)
    return read_report(path)


def _has_policies(evaluation: Mapping[str, Any]) -> bool:
    return bool({score["name"] for score in evaluation["methods"]} & set(NETWORKS.values()))


def _summary(curve: Array, gate: Gate) -> dict[str, Any]:
    rewards, quarter = curve[:, 0], max(1, len(curve) // 4)
    digits = zip(CURVE, curve.T, (4, 4, 6), strict=True)
    return {
        "gate": asdict(gate),
        "first_quarter_reward": float(rewards[:quarter].mean()),
        "last_quarter_reward": float(rewards[-quarter:].mean()),
        **{name: np.round(values, n).tolist() for name, values, n in digits},
    }
