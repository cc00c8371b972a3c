"""The lab during a camera calibration: the arm holds a board, the table is clear, nothing touches anything.

Arm and camera are those of `SimulatedLab` for the same world and seed, with the same hidden pose and errors. No plant
is needed: the arm is where its joints are, plus the errors of its joints.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
from scipy.spatial.transform import Rotation

from hw.errors import ArmFault, CameraError, DeviceUnavailable
from hw.kinematics import link_poses
from hw.ports import Arm, Camera
from hw.types import ArmState, Array, CameraModel, Execution, Frame, JointPath, frozen_array
from hw.workcell import Workcell, refuse_unless_safe
from sim.errors import SimError
from sim.lab.arm import laid_board, touching_q_rad
from sim.lab.board import BODY, HeldBoard
from sim.lab.cell import Cell
from sim.lab.film import SLICES
from sim.lab.kinect import EXPOSURE_S, default_X_BC, kinect_model
from sim.lab.rng_streams import calibration_stream, camera_stream, joint_zeros, view_stream
from sim.lab.world import Sensing, World
from sim.panda.shapes import visuals
from sim.render.renderer import WORLD, Renderer
from sim.render.sensor import SensorNoise
from sim.tasks.task import Task
from sim.types import Visual


@dataclass(frozen=True, eq=False)
class NominalCalibration:
    """The fields of a `calib.types.HandEye`, because `sim` may not import `calib`."""

    X_BC: Array  # (4, 4)
    sigma_mm: float
    sigma_deg: float
    source: str
    created: str


def nominal_of(world: World, seed: int) -> NominalCalibration:
    """The nominal calibration of the lab of `world` and `seed`: with the world's error, and a true sigma."""
    return nominal_calibration(default_X_BC(), world.sensing, calibration_stream(seed))


def nominal_calibration(X_BC: Array, sensing: Sensing, rng: np.random.Generator) -> NominalCalibration:
    """`X_BC` (4, 4) shifted by `extrinsic_error_mm` and rotated about the camera's centre by `extrinsic_error_deg`.

    Both errors are normal in three directions, with these root mean squares, which are also the stated sigmas.
    """
    shift, turn = rng.standard_normal((2, 3)) / np.sqrt(3.0)
    error = np.eye(4)
    error[:3, :3] = Rotation.from_rotvec(np.deg2rad(sensing.extrinsic_error_deg) * turn).as_matrix()
    error[:3, 3] = 1e-3 * sensing.extrinsic_error_mm * shift
    return NominalCalibration(
        X_BC=X_BC @ error,
        sigma_mm=sensing.extrinsic_error_mm,
        sigma_deg=sensing.extrinsic_error_deg,
        source="nominal calibration of the simulated lab, with the world's extrinsic error",
        created="",
    )


FRAME_RATE_HZ = 15.0
"""The camera's slower mode: enough for one swing of the board, with half the pictures."""
SETTLE_S = 0.5
TOUCH_S = 15.0
"""Time that a person takes to guide the tip to a corner."""
LENS_BLUR_PX, JPEG_QUALITY = 0.6, 92
"""Blur and JPEG quality of a Kinect's colour stream.

Pictures of trials do without, because they do not need a tenth of a pixel.
"""

_LAID, _TOUCHED = 3, 4  # streams of `view_stream`, besides those of the pictures
_HAND = "panda_hand"
_LINKS = {f"panda_link{i}": i for i in range(8)}
_HAND_TURN = -np.pi / 4


class CalibrationLab:
    """One world as a bench with a board. Entering connects arm and camera; equal inputs give equal bytes."""

    def __init__(
        self,
        task: Task,
        world: World,
        seed: int,
        board: HeldBoard,
        cell: Workcell,
        *,
        home_q_rad: Array,
    ) -> None:
        """`home_q_rad` (7,) is the arm's first posture, `cell` checks its motions. Builds nothing."""
        self._world, self._seed, self._X_BC = world, seed, default_X_BC()
        self._state = _State(frozen_array(home_q_rad, (7,), "home_q_rad"), world, seed)
        printed = board.scaled(world.sensing.board_scale)
        self.arm: Arm = _BoardArm(self._state, cell)
        self.camera: Camera = _BoardCamera(self._state, self._X_BC, printed, task)
        self.hands = _LabHands(self._state, printed)
        """The simulated person who lays the board on the table and guides the arm's tip."""

    def __enter__(self) -> Self:
        self._state.connected = True
        return self

    def __exit__(self, *exc: object) -> None:
        self._state.connected = False

    def truth(self) -> dict[str, Any]:
        """The true values that a calibration should find, only for checks."""
        return {
            "X_BC": self._X_BC.tolist(),
            "joint_offset_rad": self._state.offset_rad.tolist(),
            "clock_offset_s": 1e-3 * self._world.sensing.clock_offset_ms,
        }


class _State:
    """The shared state of arm and camera: joints, clock, random numbers."""

    def __init__(self, q_rad: Array, world: World, seed: int) -> None:
        self.world, self.seed = world, seed
        self.offset_rad = joint_zeros(seed, world.sensing.joint_offset_mrad)
        self.connected = False
        self.t_s = 0.0
        self.q_rad = q_rad  # as reported
        self.rests = 0
        self.X_BM_laid: Array | None = None  # (4, 4) the board on the table; None: in the gripper
        self.shots: list[tuple[float, JointPath]] | None = None  # of the running recording

    @property
    def error_rad(self) -> Array:
        """(7,) true minus reported joints, at this rest and on the way to the next.

        The noise is a function of the posture, so a return to the posture gives the same noise, even in a resumed run.
        """
        posture = zlib.crc32(np.round(self.q_rad, 6).tobytes())
        noise = 1e-3 * self.world.sensing.encoder_noise_mrad * view_stream(self.seed, posture, 0).standard_normal(7)
        return np.asarray(self.offset_rad + noise)

    def need_connection(self) -> None:
        if not self.connected:
            raise DeviceUnavailable("the lab is not connected: use it inside a `with` block")


class _BoardArm:
    """Plays paths exactly in reported joints."""

    def __init__(self, state: _State, cell: Workcell) -> None:
        self._state, self._cell = state, cell
        self._fault: str | None = None

    @property
    def model(self) -> str:
        return self._cell.arm.name

    def __enter__(self) -> Self:
        self._state.connected = True
        return self

    def __exit__(self, *exc: object) -> None:
        self._state.connected = False

    def state(self) -> ArmState:
        self._state.need_connection()
        return ArmState(self._state.t_s, self._state.q_rad, np.zeros(7), self._fault)

    def execute(self, path: JointPath) -> Execution:
        state = self._state
        state.need_connection()
        refuse_unless_safe(path, self._cell, state.q_rad, fault=self._fault)
        t_start_s = state.t_s
        state.rests += 1
        if state.rests in state.world.faults.arm_reflex:
            half = len(path.t_s) // 2
            state.q_rad, state.t_s = path.q_rad[half], t_start_s + float(path.t_s[half])
            self._fault = f"reflex {path.t_s[half]:.3f} s into the path: an external force was too large"
            raise ArmFault(f"{self._fault}; the arm is at rest, look at it and recover it, then run again")
        if state.shots is not None:
            state.shots.append((t_start_s, path))
        state.q_rad, state.t_s = path.q_rad[-1], t_start_s + path.duration_s + SETTLE_S
        return Execution(t_start_s, path.t_s, path.q_rad, path.q_rad, 1.0)

    def recover(self) -> None:
        self._state.need_connection()
        self._fault = None


class _LabHands:
    """The simulated person: lays the board down and guides the tip with the accuracy of a hand."""

    def __init__(self, state: _State, board: HeldBoard) -> None:
        self._state, self._board = state, board

    def lay_board(self) -> None:
        """Lay the board from the gripper onto the table, in view of the camera; always at the same place."""
        self._state.need_connection()
        self._state.X_BM_laid = laid_board(self._board, view_stream(self._state.seed, 0, _LAID))

    def touch(self, p_M_m: Array, number: int) -> None:
        """Guide the tip to a point (3,) of the stated board, tilted to another side for each `number` from 0."""
        state, laid = self._state, self._state.X_BM_laid
        state.need_connection()
        if laid is None:
            raise SimError("the board is still in the gripper: lay it on the table first")
        p_B_m = laid[:3, :3] @ (state.world.sensing.board_scale * np.asarray(p_M_m)) + laid[:3, 3]
        rng = view_stream(state.seed, number, _TOUCHED)
        encoder_rad = 1e-3 * state.world.sensing.encoder_noise_mrad * rng.standard_normal(7)
        state.q_rad = touching_q_rad(p_B_m, number, rng) - state.offset_rad - encoder_rad
        state.t_s += TOUCH_S


class _BoardCamera:
    """The lab's camera with its lens blur and compression, and its infrared image."""

    def __init__(self, state: _State, X_BC: Array, board: HeldBoard, task: Task) -> None:
        self._state, self._X_BC, self._board, self._task = state, X_BC, board, task
        self._pictures = 0

    def __enter__(self) -> Self:
        self._state.connected = True
        return self

    def __exit__(self, *exc: object) -> None:
        self._state.connected, self._state.shots = False, None

    def model(self) -> CameraModel:
        return kinect_model("small" if self._state.world.sensing.camera == "small" else "kinect")

    def snapshot(self) -> Frame:
        state = self._state
        state.need_connection()
        self._pictures += 1
        if self._pictures in state.world.faults.camera_timeout:
            raise CameraError("no frame within 1 s; check the camera's cable and power, then run again")
        return self._frame(state.t_s, (state.q_rad + state.error_rad)[None], infrared=True)

    def start_recording(self) -> None:
        self._state.need_connection()
        if self._state.shots is not None:
            raise CameraError("the camera is recording already: call stop_recording first")
        self._state.shots = []

    def stop_recording(self) -> tuple[Frame, ...]:
        state = self._state
        state.need_connection()
        if state.shots is None:
            raise CameraError("the camera is not recording: call start_recording first")
        shots, state.shots = state.shots, None
        return tuple(frame for t_start_s, path in shots for frame in self._film(t_start_s, path))

    def _film(self, t_start_s: float, path: JointPath) -> list[Frame]:
        frames = []
        for t_s in np.arange(0.5 / FRAME_RATE_HZ, path.duration_s, 1 / FRAME_RATE_HZ):
            slices_s = t_s + EXPOSURE_S * ((np.arange(SLICES) + 0.5) / SLICES - 0.5)
            q_rad = np.stack([np.interp(slices_s, path.t_s, column) for column in path.q_rad.T], axis=-1)
            frames.append(self._frame(t_start_s + t_s, q_rad + self._state.error_rad, infrared=False))
        return frames

    def _frame(self, t_s: float, q_rad: Array, *, infrared: bool) -> Frame:
        """Render a frame at true joints (S, 7)."""
        moment = round(1e6 * t_s) % 2**31
        poses, noise = self._poses(q_rad), self._noise
        colour, depth_mm = self._renderer.render(poses, noise, view_stream(self._state.seed, moment, 1))
        dark = (
            self._renderer.render_infrared(poses, noise, view_stream(self._state.seed, moment, 2)) if infrared else None
        )
        return Frame(t_s + 1e-3 * self._state.world.sensing.clock_offset_ms, colour, depth_mm, dark)

    def _poses(self, q_rad: Array) -> dict[str, Array]:
        """Joints (S, 7) -> poses (S, 4, 4) of all moving bodies, board included."""
        poses, laid = _poses(q_rad), self._state.X_BM_laid
        if laid is not None:
            poses[BODY] = np.broadcast_to(laid @ np.linalg.inv(self._board.X_FM), poses[BODY].shape)
        return poses

    @cached_property
    def _renderer(self) -> Renderer:
        still = [v for v in Cell(self._task, self._state.world).bodies.visuals if v.body == WORLD]
        return Renderer(self.model(), self._X_BC, [*still, *_arm_visuals(), *self._board.visuals()])

    @cached_property
    def _noise(self) -> SensorNoise:
        sensing = self._state.world.sensing
        own = SensorNoise.draw(camera_stream(self._state.seed), sensing.depth_noise_scale)
        shrink = 0.25 if sensing.camera == "small" else 1.0
        return replace(own, lens_blur_px=LENS_BLUR_PX * shrink, jpeg_quality=JPEG_QUALITY)


def _arm_visuals() -> tuple[Visual, ...]:
    return visuals(frozenset({*_LINKS, _HAND}))


def _poses(q_rad: Array) -> dict[str, Array]:
    """Joints (S, 7) -> poses (S, 4, 4) of the visible bodies of the arm."""
    links = link_poses(q_rad)
    turn = np.eye(4)
    turn[:2, :2] = [[np.cos(_HAND_TURN), -np.sin(_HAND_TURN)], [np.sin(_HAND_TURN), np.cos(_HAND_TURN)]]
    flange = links[:, 8]
    return {**{name: links[:, i] for name, i in _LINKS.items()}, _HAND: flange @ turn, BODY: flange}
