"""The one place that joins real parts: settings -> devices, tracker, planner and learner of one session."""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
import logging
import platform
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from adaptsim_cli.config import Config, Resolved
from adaptsim_cli.errors import UsageError
from adaptsim_cli.session.durable import make_folder
from adaptsim_cli.session.parts import (
    Learner,
    Parts,
    Paths,
    Planner,
    Prediction,
    Provenance,
    Rig,
    Tracker,
    TrackRequest,
    TrainedPolicy,
)
from calib.types import HandEye
from hw.collision import Tool
from hw.errors import DeviceUnavailable, MotionRefused
from hw.types import Array, JointPath
from perception.types import ObjectTrack, Outcome
from sim.adaptation.method import Best, Iteration, Method, Particle
from sim.errors import NotExecutable, UnknownName
from sim.tasks.task import Task
from sim.types import ToolMotion

_VERSIONED = ("adaptsim", "drake", "numpy", "opencv-python-headless", "torch")


@contextmanager
def open_parts(config: Config) -> Iterator[Parts]:
    """Everything a session needs, with its devices connected. Raises SimError, DeviceUnavailable, UsageError."""
    from sim.tasks import get_task

    logging.getLogger("drake").setLevel(logging.ERROR)  # its warnings are about features that no scene uses
    task = get_task(config.task)
    tracker = _tracker(task)
    with _open_rig(config, task) as (rig, planner, world_sha256):
        learner, checkpoint, checkpoint_sha256 = _learner(config, task, planner, rig.arm.model)
        origin = Provenance(
            checkpoint=checkpoint,
            checkpoint_sha256=checkpoint_sha256,
            world_sha256=world_sha256,
            calibration_sha256=hashlib.sha256(np.ascontiguousarray(rig.hand_eye.X_BC).tobytes()).hexdigest(),
            versions=versions(),
        )
        yield Parts(task, rig, learner, tracker, planner, origin)


def versions() -> dict[str, str]:
    found = {name: importlib.metadata.version(name) for name in _VERSIONED}
    return {"python": platform.python_version(), **found}


@contextmanager
def _open_rig(config: Config, task: Task) -> Iterator[tuple[Rig, Planner, str]]:
    if config.hw != "fake":
        raise DeviceUnavailable(
            f"hw = {config.hw}: the driver of this arm is not part of this version yet, so nothing has moved. "
            "Use --hw fake for the simulated lab"
        )
    from sim.lab import SimulatedLab
    from sim.panda.planning import home
    from sim.panda.tool import held
    from sim.world import load_world

    world, tool = load_world(config.world, task), held(task.X_FT)
    home_rad = home(task.X_FT, "panda", tool)
    with SimulatedLab(task, world, config.seed, home_q_rad=home_rad, tool=tool) as lab:
        nominal = lab.nominal_calibration()
        eye = HandEye(nominal.X_BC, nominal.sigma_mm, nominal.sigma_deg, nominal.source, nominal.created)
        rig = Rig("fake", f"simulated lab, world {world.name}", lab.arm, lab.camera, lab.bench, eye)
        yield rig, _planner(task, rig.arm.model, home_rad, tool), _world_sha256(config.world)


def _world_sha256(name_or_path: str) -> str:
    """Of the file of an own world; of the name of one that ships with this version."""
    path = Path(name_or_path).expanduser()
    content = path.read_bytes() if path.is_file() else repr(name_or_path).encode()
    return hashlib.sha256(content).hexdigest()


def _planner(task: Task, model: str, home_rad: Array, tool: Tool) -> Planner:
    from hw.kinematics import forward
    from hw.limits import require
    from sim.panda.planning import trial_paths

    planned: dict[bytes, Paths] = {}  # asked for by the policy, by its prediction, and by the trial itself

    def paths(motion: ToolMotion) -> Paths:
        key = motion.X_BT.tobytes()
        if key not in planned:
            planned[key] = trial_paths(motion, task.X_FT, model, home_rad, tool=tool)
        return planned[key]

    def check(path: JointPath, arm: str) -> None:
        require(path, arm, tool=tool)

    return Planner(paths, check, forward)


@dataclass(frozen=True, eq=False)
class _Policy:
    """An emulator's task policy, as the sequence wants it."""

    policy: Any

    def __call__(self, context: Array) -> Array:
        return np.asarray(self.policy(context))

    def predict(self, context: Array) -> Prediction:
        return Prediction(*self.policy.predict(context))


@dataclass(frozen=True, eq=False)
class _EmulatorLearner:
    """A method of adaptation, and task policies trained in the checkpoint's emulator."""

    task: Task
    method: Method
    emulator: Any
    executable: Callable[[Array, Array], bool]

    def start(self, n: int, rng: np.random.Generator) -> tuple[Particle, ...]:
        return self.method.start(n, rng)

    def next(self, history: Sequence[Iteration], rng: np.random.Generator) -> tuple[Particle, ...]:
        return self.method.next(history, rng)

    def train(self, particle: Particle, rng: np.random.Generator) -> TrainedPolicy:
        from sim.task_policy import train_task_policy

        return _Policy(train_task_policy(self.task, self.emulator, particle.samples, rng, self.executable))

    def judge(self, history: Sequence[Iteration], rng: np.random.Generator) -> tuple[Best, str]:
        from sim.adaptation import choose_best, verdict

        return choose_best(self.task, history), verdict(self.task, history, self.emulator)


def _learner(config: Config, task: Task, planner: Planner, arm: str) -> tuple[Learner, str, str]:
    """(learner, name of its checkpoint, hash of its weights)."""
    from sim.adaptation import make_method
    from sim.checkpoint import load_checkpoint

    checkpoint = load_checkpoint(task, config.checkpoint or "default")

    def executable(context: Array, action: Array) -> bool:
        if task.plan is None:
            return True
        try:
            for path in planner.paths(task.plan(context, action)):
                planner.check(path, arm)
        except (NotExecutable, MotionRefused):
            return False
        return True

    learner = _EmulatorLearner(task, make_method(config.method, task, checkpoint), checkpoint.emulator, executable)
    return learner, f"{task.name}/{checkpoint.path.name}", checkpoint.sha256


def pretrain(
    resolved: Resolved,
    out: Path | None,
    budget: str,
    rollouts: int | None,
    progress: Callable[[str, int, int], None],
) -> Path:
    """Phase 1 with the settings' task, seed and workers -> the folder of the checkpoint. Resumes what is in `out`.

    Raises UsageError on an unknown budget, SimError, SessionError.
    """
    from sim.adaptation.phase1 import PretrainBudget, pretrain
    from sim.rollouts.executors import process_pool
    from sim.tasks import get_task

    budgets = {"full": PretrainBudget, "small": PretrainBudget.small}
    if budget not in budgets:
        raise UsageError(f"--budget {budget}: it is one of {', '.join(budgets)}")
    config = resolved.config
    task, chosen = get_task(config.task), budgets[budget]()
    if rollouts is not None:
        chosen = replace(chosen, rollouts=rollouts)
    folder = out or resolved.places.pretraining / f"{task.name}-{budget}-seed{config.seed}"
    make_folder(folder.absolute())
    with process_pool(config.workers or None) as executor:
        return pretrain(task, folder.absolute(), chosen, config.seed, executor, progress)


def list_checkpoints(resolved: Resolved) -> list[dict[str, str]]:
    """Shipped checkpoints and the user's own ones. Raises CheckpointError on a card that cannot be read."""
    from sim.checkpoint import CARD, list_checkpoints, read_card

    own = sorted(card.parent for card in resolved.places.pretraining.glob(f"*/checkpoint/{CARD}"))
    named = [(name, folder) for _, name, folder in list_checkpoints()] + [
        (folder.parent.name, folder) for folder in own
    ]
    cards = [(name, folder, read_card(folder, "any task")) for name, folder in named]
    return [
        {"task": str(card["task"]), "name": name, "created": str(card.get("created", "")), "folder": str(folder)}
        for name, folder, card in cards
    ]


def checkpoint_card(task: str, folder: Path) -> dict[str, Any]:
    """The card of a checkpoint, ready for JSON. Raises CheckpointError."""
    from sim.checkpoint import read_card

    card: dict[str, Any] = json.loads(json.dumps(read_card(folder, task), default=str))
    return card


def verify_checkpoint(config: Config) -> dict[str, str]:
    """Load a checkpoint against its card and its task. Raises CheckpointError, UnknownName."""
    from sim.checkpoint import load_checkpoint
    from sim.tasks import get_task

    checkpoint = load_checkpoint(get_task(config.task), config.checkpoint or "default")
    return {"task": config.task, "folder": str(checkpoint.path), "sha256": checkpoint.sha256}


def _tracker(task: Task) -> Tracker:
    if task.tracker not in TRACKERS:
        raise UnknownName(f"no tracker {task.tracker!r} for {task.name}: there are {', '.join(TRACKERS)}")
    return TRACKERS[task.tracker](task)


def _piece(task: Task) -> Tracker:
    """A piece of food, seen and followed with the blade at its kinematic pose; it lies where the context says."""
    from perception import piece
    from sim.tasks.tool_mesh import tool_mesh

    mesh = tool_mesh(task)
    x, y = task.context.dimensions[:2]
    area = (x.low, x.high, y.low, y.high)

    def track(request: TrackRequest) -> ObjectTrack:
        return piece.track_piece(
            request.frames,
            request.model,
            request.X_BC,
            request.detection,
            mesh,
            request.X_BT_at,
            request.t_start_s,
            request.duration_s,
        )

    return Tracker(
        find=lambda frame, model, X_BC: piece.find_piece(frame, model, X_BC, area),
        overlay=lambda frame, model, X_BC, found, wanted_m: piece.overlay(frame, model, X_BC, found, area, wanted_m),
        track=track,
        placement=lambda drawn: drawn,
        context=lambda drawn, detection: np.asarray(detection.xy_m),
        outcomes=(Outcome.ON_BLADE, Outcome.ON_TABLE, Outcome.LOST),
    )


TRACKERS: dict[str, Callable[[Task], Tracker]] = {"piece": _piece}
"""`Task.tracker` -> how its object is seen."""
