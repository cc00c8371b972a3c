"""Joins the parts of a session: settings -> devices, tracker, planner and learner."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

import numpy as np

from adaptsim_cli.config import SIMULATED, Config, Places, places
from adaptsim_cli.devices.attended import AttendedRig, Person
from adaptsim_cli.devices.mounted import mounted
from adaptsim_cli.devices.opening import open_lab
from adaptsim_cli.devices.rig_file.reading import tasks_with_tools
from adaptsim_cli.devices.trackers import tracker_of
from adaptsim_cli.errors import UsageError
from adaptsim_cli.session.in_simulation import InSimulation
from adaptsim_cli.session.on_rig import OnRig
from adaptsim_cli.session.parts import Parts, Provenance
from adaptsim_cli.session.policy import Prediction, TrainedPolicy
from adaptsim_cli.session.records import RigFacts
from adaptsim_cli.session.rig import Planner, Rig
from adaptsim_cli.session.target import Target
from adaptsim_cli.storage.versions import versions
from adaptsim_cli.wiring.calibration import calibration_of
from adaptsim_cli.wiring.checkpoints import checkpoint_of
from adaptsim_cli.wiring.touch_off import touch_off_of
from calib.types import HandEye
from hw.collision import camera_box
from hw.errors import MotionRefused
from hw.types import Array
from hw.workcell import arm_model
from perception.types import ObjectTrack
from sim.adaptation.method import Best, Iteration, Method, Particle
from sim.errors import NotExecutable
from sim.solvers.solver import Executable, SolvedPolicy, Solver
from sim.tasks.task import Task

if TYPE_CHECKING:
    from adaptsim_cli.devices.mounted import MountedTask
    from adaptsim_cli.devices.openers import Openers
    from sim.lab.simulated import SimulatedLab
    from sim.lab.world import World


@contextmanager
def open_parts(config: Config, learnt: Path, openers: Openers | None = None) -> Iterator[Parts]:
    """Everything a session needs, with its devices connected. `openers`: how those of a real lab are opened.

    NAF keeps its policies and rollouts in the folder `learnt`, which nobody else may use meanwhile.

    Raises SimError, DeviceUnavailable, CalibrationMissing, UsageError.
    """
    from adaptsim_cli.wiring.solvers import solver_of
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
            world_sha256=_world_sha256(config.world) if config.is_simulated else "",
            calibration=calibration.source if calibration else "",
            calibration_sha256=_sha256(np.stack([calibration.X_BC, task.require_hardware().X_FT]))
            if calibration
            else "",
            versions=versions(),
            camera_late_s=calibration.camera_late_s if calibration else 0.0,
        )
        yield Parts(task, target, learner, origin)


_Opened = tuple[Task, Target, Executable | None, HandEye | None]


@contextmanager
def _open_target(config: Config, task: Task, openers: Openers | None) -> Iterator[_Opened]:
    """The task as mounted there, where trials happen, what can be executed, the calibration."""
    if task.hardware is None:
        yield task, _simulated(config, task), None, None
    elif not config.is_simulated:
        with open_real(config, places(), task, openers) as real:
            on_rig = real.on_rig
            executable = _executable(task, on_rig.planner)
            yield real.mounted.task, real, executable, on_rig.rig.hand_eye
    else:
        with _open_lab(config, task) as on_rig:
            executable = _executable(task, on_rig.planner)
            yield on_rig.task, on_rig, executable, on_rig.rig.hand_eye


def _simulated(config: Config, task: Task) -> InSimulation:
    """A world of a task that needs no hardware. Raises UsageError where some was asked for."""
    if not config.is_simulated:
        raise UsageError(
            f"--hw {config.hw}: the task {task.name} runs in simulation only, there is nothing that a robot could do. "
            "Leave --hw out, or choose another --task"
        )
    from sim.lab.rollouts import rollouts_in
    from sim.lab.world import load_world

    world = load_world(config.world, task)
    there = rollouts_in(world)

    def rollout(context: Array, action: Array) -> ObjectTrack:
        return there(world.parameters, context, action, world.nuisance)

    duration_s = float(task.observation.times_s[-1])
    return InSimulation(task.object_name, duration_s, f"simulated target, world {world.name}", rollout)


def _sha256(array: Array) -> str:
    return hashlib.sha256(np.ascontiguousarray(array).tobytes()).hexdigest()


@contextmanager
def _open_lab(config: Config, task: Task) -> Iterator[OnRig]:
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
    from adaptsim_cli.devices.mounted import mounted_as_shipped
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
    rig = Rig(SIMULATED, f"simulated lab, {lab.title}", lab.arm, lab.camera, lab.bench, over_table, days)
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

    def train(self, particle: Particle, history: Sequence[Iteration]) -> TrainedPolicy:
        from sim.adaptation.method import policy_of

        return _Policy(policy_of(self.method, self.solver, particle, history, self.executable))

    def judge(self, history: Sequence[Iteration], rng: np.random.Generator) -> tuple[Best, str]:
        from sim.adaptation.best import choose_best
        from sim.adaptation.verdict import verdict

        return choose_best(self.solver.task, history), verdict(self.solver.task, history, self.solver)


def _executable(task: Task, planner: Planner) -> Executable:
    plan = task.require_hardware().plan

    def executable(context: Array, action: Array) -> bool:
        try:
            for path in planner.paths(plan(context, action)):
                planner.check(path)
        except (NotExecutable, MotionRefused):
            return False
        return True

    return executable


@runtime_checkable
class _Telling(Protocol):
    """A camera that says how it was set and how its last recording went."""

    def facts(self) -> dict[str, Any]: ...


@contextmanager
def open_real(config: Config, places: Places, task: Task, openers: Openers | None = None) -> Iterator[AttendedRig]:
    """The devices of the rig file, connected, the arm last. Nothing moves.

    Everything that can be wrong without a device is found first. Raises UsageError (rig file, no terminal),
    SessionError (a touch-off cannot be read), PreflightFailed (it is stale), CalibrationMissing, NotExecutable (the
    tool cannot be held), DeviceUnavailable, CameraError.
    """
    with open_lab(config, tasks_with_tools(), openers) as lab:
        eye, zeros_rad = calibration_of(config, places, None)
        known = touch_off_of(config, places, zeros_rad)  # what it found counts more than what the rig file says
        correction = None if known is None else known.correction()
        there = mounted(task, arm_model(lab.rig.arm.model, zeros_rad), lab.rig, (camera_box(eye.X_BC),), correction)
        if known is not None:
            lab.screen.note(f"Table and tool are where the touch-off of {known.created} found them.")
        arm = lab.arm(there.cell, task.name)
        camera, scales = lab.camera(infrared=False), lab.scales()
        lab.connect(arm)

        def facts() -> RigFacts:
            said = camera.facts() if isinstance(camera, _Telling) else None
            return (scales.facts if scales else RigFacts()).model_copy(update={"camera": said})

        over_table = replace(eye, X_BC=there.correction.X_WB @ eye.X_BC)  # trials are seen over the table, in frame W
        days = config.calibration_days
        rig = Rig(config.hw, lab.title, arm, camera, Person(), over_table, days, time.sleep, arm.await_pedal)
        on_rig = OnRig(there.task, rig, tracker_of(there.task), there.planner(), facts)
        yield AttendedRig(on_rig, arm, there, lab.screen, scales)
