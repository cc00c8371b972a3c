"""The one place that joins real parts: settings -> devices, tracker, planner and learner of one session."""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
import platform
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from adaptsim_cli.config import Config, Resolved, places
from adaptsim_cli.errors import UsageError
from adaptsim_cli.screen.continuing import how_to_continue
from adaptsim_cli.session.in_simulation import InSimulation
from adaptsim_cli.session.on_rig import OnRig
from adaptsim_cli.session.parts import (
    Parts,
    Planner,
    Prediction,
    Provenance,
    Rig,
    TrainedPolicy,
)
from adaptsim_cli.session.target import Target
from adaptsim_cli.storage.durable import make_folder
from adaptsim_cli.storage.locking import locked
from adaptsim_cli.trackers import tracker_of
from adaptsim_cli.wiring_calibration import calibration_of
from adaptsim_cli.wiring_checkpoints import checkpoint_of, own_checkpoints, task_of
from calib.types import HandEye
from hw.errors import MotionRefused
from hw.types import Array
from perception.types import ObjectTrack
from sim.adaptation.method import Best, Iteration, Method, Particle
from sim.errors import NotExecutable
from sim.solvers.solver import Executable, SolvedPolicy, Solver
from sim.tasks.task import Task

if TYPE_CHECKING:
    from adaptsim_cli.mounted import MountedTask
    from adaptsim_cli.rigs.openers import Openers
    from sim.lab.simulated import SimulatedLab
    from sim.lab.world import World
    from sim.pretraining.pipeline import PretrainBudget

_VERSIONED = ("adaptsim", "drake", "numpy", "opencv-python-headless", "torch")


@contextmanager
def open_parts(config: Config, learnt: Path, openers: Openers | None = None) -> Iterator[Parts]:
    """Everything a session needs, with its devices connected. `openers`: how those of a real lab are opened.

    NAF keeps its policies and rollouts in the folder `learnt`, which nobody else may use meanwhile.

    Raises SimError, DeviceUnavailable, CalibrationMissing, UsageError.
    """
    from adaptsim_cli.wiring_solvers import solver_of
    from sim.adaptation.methods import make_method

    checkpoint = checkpoint_of(config)
    own = checkpoint.solver.task
    with (
        _open_target(config, own, openers) as (task, target, executable, calibration),
        solver_of(checkpoint, config.solver, config.workers, learnt) as solver,
    ):
        learner = _SolverLearner(make_method(config.method, own, checkpoint), solver, executable)
        origin = Provenance(
            checkpoint=f"{own.name}/{checkpoint.path.name}",
            checkpoint_sha256=checkpoint.sha256,
            world_sha256=_world_sha256(config.world) if config.hw == "fake" else "",
            calibration=calibration.source if calibration else "",
            calibration_sha256=_sha256(np.stack([calibration.X_BC, task.X_FT])) if calibration else "",
            versions=versions(),
            camera_late_s=calibration.camera_late_s if calibration else 0.0,
        )
        yield Parts(task, target, learner, origin)


_Opened = tuple[Task, Target, Executable | None, HandEye | None]


@contextmanager
def _open_target(config: Config, task: Task, openers: Openers | None) -> Iterator[_Opened]:
    """The task as mounted there, where trials happen, what can be executed, the calibration."""
    if task.plan is None:
        yield task, _simulated(config, task), None, None
    elif config.hw != "fake":
        from adaptsim_cli.rigs.openers import real_devices
        from adaptsim_cli.rigs.opening import open_real

        with open_real(config, places(), task, openers or real_devices()) as real:
            on_rig = real.on_rig
            executable = _executable(task, on_rig.planner)
            yield real.mounted.task, real, executable, on_rig.rig.hand_eye
    else:
        with _open_lab(config, task) as on_rig:
            executable = _executable(task, on_rig.planner)
            yield on_rig.task, on_rig, executable, on_rig.rig.hand_eye


def _simulated(config: Config, task: Task) -> InSimulation:
    """A world of a task that needs no hardware. Raises UsageError where some was asked for."""
    if config.hw != "fake":
        raise UsageError(
            f"--hw {config.hw}: the task {task.name} runs in simulation only, there is nothing that a robot could do. "
            "Leave --hw out, or choose another --task"
        )
    from sim.lab.world import load_world

    world = load_world(config.world, task)

    def rollout(context: Array, action: Array) -> ObjectTrack:
        return task.simulate(world.parameters, context, action, world.nuisance, world.unmodelled)

    duration_s = float(task.observation.times_s[-1])
    return InSimulation(task.object_name, duration_s, f"simulated target, world {world.name}", rollout)


def _sha256(array: Array) -> str:
    return hashlib.sha256(np.ascontiguousarray(array).tobytes()).hexdigest()


def versions() -> dict[str, str]:
    found = {name: importlib.metadata.version(name) for name in _VERSIONED}
    return {"python": platform.python_version(), **found}


@contextmanager
def _open_lab(config: Config, task: Task) -> Iterator[OnRig]:
    from adaptsim_cli.mounted import mounted
    from adaptsim_cli.touch_off.store import touch_off_of
    from hw.workcell import arm_model
    from sim.lab.simulated import SimulatedLab
    from sim.lab.world import load_world

    world = load_world(config.world, task)
    eye, zeros_rad = calibration_of(config, places(), _nominal(world, config.seed))
    touched = touch_off_of(config, places(), zeros_rad)
    correction = None if touched is None else touched.correction()
    there = mounted(task, arm_model("panda", zeros_rad), None, (), correction)
    with SimulatedLab(task, world, config.seed, there.cell, home_q_rad=there.home_rad) as lab:
        yield _on_rig(there, lab, eye, config.calibration_days)


@contextmanager
def lab_as_shipped(task: Task, world: World, seed: int) -> Iterator[tuple[SimulatedLab, OnRig]]:
    """A simulated lab before any calibration or touch-off of its own, and its rig, with its devices connected."""
    from adaptsim_cli.mounted import mounted_as_shipped
    from sim.lab.simulated import SimulatedLab

    there = mounted_as_shipped(task, "panda")
    with SimulatedLab(task, world, seed, there.cell, home_q_rad=there.home_rad) as lab:
        yield lab, _on_rig(there, lab, _nominal(world, seed))


def _nominal(world: World, seed: int) -> HandEye:
    from sim.lab.calibration import nominal_of

    shipped = nominal_of(world, seed)
    return HandEye(shipped.X_BC, shipped.sigma_mm, shipped.sigma_deg, shipped.source, shipped.created)


def _on_rig(there: MountedTask, lab: SimulatedLab, eye: HandEye, days: int = 30) -> OnRig:
    over_table = replace(eye, X_BC=there.correction.X_WB @ eye.X_BC)  # trials are seen over the table, in frame W
    rig = Rig("fake", f"simulated lab, {lab.title}", lab.arm, lab.camera, lab.bench, over_table, days)
    return OnRig(there.task, rig, tracker_of(there.task), there.planner())


def _world_sha256(name_or_path: str) -> str:
    """Of the file of an own world; of the name of one that ships with this version."""
    path = Path(name_or_path).expanduser()
    content = path.read_bytes() if path.is_file() else repr(name_or_path).encode()
    return hashlib.sha256(content).hexdigest()


@dataclass(frozen=True, eq=False)
class _Policy:
    """A solver's task policy, as the sequence wants it."""

    policy: SolvedPolicy

    def __call__(self, context: Array) -> Array:
        return np.asarray(self.policy(context))

    def predict(self, context: Array) -> Prediction:
        return Prediction(*self.policy.predict(context))


@dataclass(frozen=True, eq=False)
class _SolverLearner:
    """A method of adaptation, and task policies of the checkpoint's solver."""

    method: Method
    solver: Solver
    executable: Executable | None

    def start(self, n: int, rng: np.random.Generator) -> tuple[Particle, ...]:
        return self.method.start(n, rng)

    def next(self, history: Sequence[Iteration], rng: np.random.Generator) -> tuple[Particle, ...]:
        return self.method.next(history, rng)

    def train(self, particle: Particle) -> TrainedPolicy:
        from sim.solvers.solver import policy_for

        return _Policy(policy_for(self.solver, particle.samples, self.executable))

    def judge(self, history: Sequence[Iteration], rng: np.random.Generator) -> tuple[Best, str]:
        from sim.adaptation.best import choose_best
        from sim.adaptation.verdict import verdict

        return choose_best(self.solver.task, history), verdict(self.solver.task, history, self.solver)


def _executable(task: Task, planner: Planner) -> Executable:
    def executable(context: Array, action: Array) -> bool:
        if task.plan is None:
            return True
        try:
            for path in planner.paths(task.plan(context, action)):
                planner.check(path)
        except (NotExecutable, MotionRefused):
            return False
        return True

    return executable


@dataclass(frozen=True)
class Sizes:
    """What is asked for instead of the budget's; None: the budget's."""

    rollouts: int | None = None  # of the dataset, evenly over the space
    denser: int | None = None  # and where the outcome is uncertain
    steps: int | None = None  # adaptation steps that the Q-policy learns from
    judged: int | None = None  # unseen targets of the evaluation

    def of(self, budget: PretrainBudget) -> PretrainBudget:
        """The budget with these sizes."""
        return replace(
            budget,
            rollouts=_either(self.rollouts, budget.rollouts),
            denser=_either(self.denser, budget.denser),
            meta=replace(budget.meta, steps=_either(self.steps, budget.meta.steps)),
            evaluation=replace(budget.evaluation, targets=_either(self.judged, budget.evaluation.targets)),
        )

    @property
    def label(self) -> str:
        """Part of a folder's name; empty where nothing was asked for."""
        asked = zip(
            ("", "denser", "steps", "judged"), (self.rollouts, self.denser, self.steps, self.judged), strict=True
        )
        return "-".join(f"{what}{size}" for what, size in asked if size is not None)


def _either(asked: int | None, usual: int) -> int:
    return usual if asked is None else asked


def pretrain(
    resolved: Resolved,
    out: Path | None,
    budget: str,
    targets: str,
    sizes: Sizes,
    executor: Executor,
    progress: Callable[[str, int, int], None],
) -> Path:
    """Phase 1 with the settings' task, solver and seed -> the folder of the checkpoint. Resumes what is in `out`.

    Raises UsageError on an unknown budget, solver or kind of targets, SimError, SessionError.
    """
    from adaptsim_cli.wiring_solvers import SOLVERS
    from sim.pretraining.meta_training import TARGETS
    from sim.pretraining.pipeline import PretrainBudget, pretrain

    budgets = {"full": PretrainBudget, "small": PretrainBudget.small}
    if budget not in budgets:
        raise UsageError(f"--budget {budget}: it is one of {', '.join(budgets)}")
    config = resolved.config
    solver = config.solver or SOLVERS[0]
    if solver not in SOLVERS:
        raise UsageError(f"--solver {solver}: it is one of {', '.join(SOLVERS)}")
    kind = next((known for known in TARGETS if known == targets), None)
    if kind is None:
        raise UsageError(f"--targets {targets}: it is one of {', '.join(TARGETS)}")
    task, chosen = task_of(config), sizes.of(budgets[budget]().on_targets(kind))
    unusual = (
        Path(config.object).stem,
        solver if solver != SOLVERS[0] else "",
        targets if targets != TARGETS[0] else "",
        budget,
        sizes.label,
    )
    parts = (task.name, *(part for part in unusual if part), f"seed{config.seed}")
    folder = (out or resolved.places.pretraining / "-".join(parts)).absolute()
    make_folder(folder)
    with (
        locked(folder, f"another pretraining is at work in {folder}: wait for it, or give another --out"),
        how_to_continue("What is finished is kept: the same command goes on", "interrupted"),
    ):
        return pretrain(task, folder, chosen, config.seed, executor, progress, solver)


def open_executor(config: Config, kind: str, scheduler: str) -> AbstractContextManager[Executor]:
    """Where simulations run: processes of this machine, or a Dask cluster. Raises UsageError, ClusterUnavailable."""
    from sim.rollouts.executors import dask_cluster, process_pool

    if kind == "processes" and not scheduler:
        return process_pool(config.workers or None)
    if kind == "dask" and scheduler:
        return dask_cluster(scheduler)
    if kind not in ("processes", "dask"):
        raise UsageError(f"--executor {kind}: it is one of processes, dask")
    raise UsageError("--executor dask and --scheduler ADDRESS belong together")


def list_checkpoints() -> list[dict[str, str]]:
    """Shipped checkpoints and the user's own ones; `created` tells where a card cannot be read."""
    from sim.adaptation.checkpoint import list_checkpoints, read_card
    from sim.errors import CheckpointError

    def row(name: str, folder: Path) -> dict[str, str]:
        try:
            card = read_card(folder, "any task")
        except CheckpointError as error:
            card = {"task": "?", "created": f"cannot be read: {error}"}
        return {"task": str(card["task"]), "name": name, "created": str(card.get("created", "")), "folder": str(folder)}

    named = [(name, folder) for _, name, folder in list_checkpoints()]
    named += [(folder.parent.name, folder) for folder in own_checkpoints()]
    return [row(name, folder) for name, folder in named]


def checkpoint_card(task: str, folder: Path) -> dict[str, Any]:
    """The card of a checkpoint, ready for JSON: null where a figure is not a number. Raises CheckpointError."""
    from sim.adaptation.checkpoint import read_card

    text = json.dumps(read_card(folder, task), default=str)
    card: dict[str, Any] = json.loads(text, parse_constant=lambda _: None)
    return card
