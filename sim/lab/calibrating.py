"""The lab during a camera calibration: the arm holds a board, the table is clear, and nothing touches anything.

Arm and camera are those of `SimulatedLab` for the same world and seed, with the same hidden pose and errors. No plant
is needed, because the arm follows from its joints and their errors.
"""

from __future__ import annotations

import zlib
from dataclasses import replace
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from hw.errors import ArmFault, CameraError, DeviceUnavailable
from hw.kinematics import link_poses
from hw.ports import Camera
from hw.poses import pose
from hw.types import Array, CameraModel, Execution, Frame, JointPath, frozen_array
from hw.workcell import Workcell, refuse_unless_safe
from sim.errors import SimError
from sim.lab.arm import ArmInLab, laid_board, touching_q_rad
from sim.lab.board import BODY, HeldBoard
from sim.lab.cell import Cell
from sim.lab.film import SLICES
from sim.lab.kinect import EXPOSURE_S, default_X_BC, kinect_model, moved_X_BC
from sim.lab.rng_streams import calibration_stream, camera_stream, joint_zeros, moved_stream, view_stream
from sim.lab.world import Sensing, World
from sim.panda.shapes import visuals
from sim.render.renderer import WORLD, Renderer
from sim.render.sensor import SensorNoise
from sim.tasks.task import Task


def nominal_X_BC(world: World, seed: int) -> Array:
    """(4, 4) the nominal calibration of the lab of `world` and `seed`: with the world's error."""
    return with_extrinsic_error(default_X_BC(), world.sensing, calibration_stream(seed))


def with_extrinsic_error(X_BC: Array, sensing: Sensing, rng: np.random.Generator) -> Array:
    """`X_BC` (4, 4) shifted by `extrinsic_error_mm` and rotated about the camera's centre by `extrinsic_error_deg`.

    Both errors are normal in three directions, with these root mean squares.
    """
    shift, turn = rng.standard_normal((2, 3)) / np.sqrt(3.0)
    R = Rotation.from_rotvec(np.deg2rad(sensing.extrinsic_error_deg) * turn).as_matrix()
    return np.asarray(X_BC @ pose(R, 1e-3 * sensing.extrinsic_error_mm * shift))


FRAME_RATE_HZ = 15.0
"""The camera's slower mode, which is enough for one swing of the board and needs half the pictures."""
SETTLE_S = 0.5
TOUCH_S = 15.0
"""Time that a person takes to guide the tip to a corner."""
LENS_BLUR_PX, JPEG_QUALITY = 0.6, 92
"""Blur and JPEG quality of a Kinect's colour stream.

Pictures of trials have neither, because they do not need a tenth of a pixel."""

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
        self._world, sensing = world, world.sensing
        X_WC = moved_X_BC(sensing.camera_moved_mm, sensing.camera_moved_deg, moved_stream(seed))
        self._X_BC = world.mount.true.X_BW @ X_WC
        printed = board.scaled(world.sensing.board_scale)
        self.arm = _BoardArm(world, seed, cell, frozen_array(home_q_rad, (7,), "home_q_rad"))
        self.hands = _LabHands(self.arm, printed)
        """The simulated person who lays the board on the table and guides the arm's tip."""
        self.camera: Camera = _BoardCamera(self.arm, self.hands, X_WC, task)

    def __enter__(self) -> Self:
        self.arm.__enter__()
        self.camera.__enter__()
        return self

    def __exit__(self, *exc: object) -> None:
        self.camera.__exit__(*exc)
        self.arm.__exit__(*exc)

    def truth(self) -> dict[str, Any]:
        """The true values that a calibration should find, only for checks."""
        return {
            "X_BC": self._X_BC.tolist(),
            "joint_offset_rad": self.arm.offset_rad.tolist(),
            "clock_offset_s": 1e-3 * self._world.sensing.clock_offset_ms,
        }


class _BoardArm(ArmInLab):
    """Plays paths exactly in reported joints."""

    def __init__(self, world: World, seed: int, cell: Workcell, q_rad: Array) -> None:
        super().__init__(cell, "run again")
        self.world, self.seed = world, seed
        self.offset_rad = joint_zeros(seed, world.sensing.joint_offset_mrad)
        self.t_s, self.q_rad = 0.0, q_rad  # joints as reported
        self._rests = 0
        self.shots: list[tuple[float, JointPath]] | None = None  # of the running recording

    def _now(self) -> tuple[float, Array]:
        return self.t_s, self.q_rad

    @property
    def error_rad(self) -> Array:
        """(7,) true minus reported joints, at this rest and on the way to the next.

        The noise is a function of the posture, so a return to the posture gives the same noise, even in a resumed run.
        """
        posture = zlib.crc32(np.round(self.q_rad, 6).tobytes())
        noise = 1e-3 * self.world.sensing.encoder_noise_mrad * view_stream(self.seed, posture, 0).standard_normal(7)
        return np.asarray(self.offset_rad + noise)

    def execute(self, path: JointPath) -> Execution:
        self.need_connection()
        refuse_unless_safe(path, self._cell, self.q_rad, fault=self._fault)
        t_start_s = self.t_s
        self._rests += 1
        if self._rests in self.world.faults.arm_reflex:
            half = len(path.t_s) // 2
            self.q_rad, self.t_s = path.q_rad[half], t_start_s + float(path.t_s[half])
            why = f"reflex {path.t_s[half]:.3f} s into the path: an external force was too large"
            raise self._stopped(ArmFault, why)
        if self.shots is not None:
            self.shots.append((t_start_s, path))
        self.q_rad, self.t_s = path.q_rad[-1], t_start_s + path.duration_s + SETTLE_S
        return Execution(t_start_s, path.t_s, path.q_rad, path.q_rad, 1.0)


class _LabHands:
    """The simulated person: lays the board down and guides the tip with the accuracy of a hand."""

    def __init__(self, arm: _BoardArm, board: HeldBoard) -> None:
        self._arm, self.board = arm, board  # as printed
        self.X_WM_laid: Array | None = None  # (4, 4) the board on the table; None: in the gripper

    def lay_board(self) -> None:
        """Lay the board from the gripper onto the table, in view of the camera; always at the same place."""
        self._arm.need_connection()
        self.X_WM_laid = laid_board(self.board, view_stream(self._arm.seed, 0, _LAID))

    def touch(self, p_M_m: Array, number: int) -> None:
        """Guide the tip to a point (3,) of the stated board, tilted to another side for each `number` from 0."""
        arm, laid = self._arm, self.X_WM_laid
        arm.need_connection()
        if laid is None:
            raise SimError("the board is still in the gripper: lay it on the table first")
        p_W_m = laid[:3, :3] @ (arm.world.sensing.board_scale * np.asarray(p_M_m)) + laid[:3, 3]
        X_BW = arm.world.mount.true.X_BW
        p_B_m = X_BW[:3, :3] @ p_W_m + X_BW[:3, 3]
        rng = view_stream(arm.seed, number, _TOUCHED)
        encoder_rad = 1e-3 * arm.world.sensing.encoder_noise_mrad * rng.standard_normal(7)
        arm.q_rad = touching_q_rad(p_B_m, number, rng) - arm.offset_rad - encoder_rad
        arm.t_s += TOUCH_S


class _BoardCamera:
    """The lab's camera with its lens blur and compression, and its infrared image."""

    def __init__(self, arm: _BoardArm, hands: _LabHands, X_WC: Array, task: Task) -> None:
        """`X_WC` (4, 4) is its pose over the table, in whose frame W everything is rendered."""
        self._arm, self._hands, self._X_WC, self._task = arm, hands, X_WC, task
        self._sensing = arm.world.sensing
        self._pictures, self._connected = 0, False
        self._newest: NDArray[np.uint8] | None = None

    def __enter__(self) -> Self:
        self._connected = True
        return self

    def __exit__(self, *exc: object) -> None:
        self._connected, self._arm.shots = False, None

    def model(self) -> CameraModel:
        return kinect_model(self._sensing.camera)

    def snapshot(self) -> Frame:
        self._need_connection()
        self._pictures += 1
        if self._pictures in self._arm.world.faults.camera_timeout:
            raise CameraError("no frame within 1 s; check the camera's cable and power, then run again")
        return self._frame(self._arm.t_s, (self._arm.q_rad + self._arm.error_rad)[None], infrared=True)

    def start_recording(self) -> None:
        self._need_connection()
        if self._arm.shots is not None:
            raise CameraError("the camera is recording already: call stop_recording first")
        self._arm.shots = []

    def stop_recording(self) -> tuple[Frame, ...]:
        self._need_connection()
        shots, self._arm.shots = self._arm.shots, None
        if shots is None:
            raise CameraError("the camera is not recording: call start_recording first")
        return tuple(frame for t_start_s, path in shots for frame in self._film(t_start_s, path))

    def newest(self) -> NDArray[np.uint8] | None:
        return self._newest

    def _film(self, t_start_s: float, path: JointPath) -> list[Frame]:
        frames = []
        for t_s in np.arange(0.5 / FRAME_RATE_HZ, path.duration_s, 1 / FRAME_RATE_HZ):
            slices_s = t_s + EXPOSURE_S * ((np.arange(SLICES) + 0.5) / SLICES - 0.5)
            q_rad = np.stack([np.interp(slices_s, path.t_s, column) for column in path.q_rad.T], axis=-1)
            frames.append(self._frame(t_start_s + t_s, q_rad + self._arm.error_rad, infrared=False))
        return frames

    def _frame(self, t_s: float, q_rad: Array, *, infrared: bool) -> Frame:
        """Render a frame at true joints (S, 7)."""
        moment, seed = round(1e6 * t_s) % 2**31, self._arm.seed
        poses, noise = self._poses(q_rad), self._noise
        colour, depth_mm = self._renderer.render(poses, noise, view_stream(seed, moment, 1))
        dark = self._renderer.render_infrared(poses, noise, view_stream(seed, moment, 2)) if infrared else None
        self._newest = colour
        return Frame(self._sensing.stamped(t_s), colour, depth_mm, dark)

    def _poses(self, q_rad: Array) -> dict[str, Array]:
        """Joints (S, 7) -> poses (S, 4, 4) of all moving bodies over the table, board included."""
        links = self._arm.world.mount.true.X_WB @ link_poses(q_rad)
        turn = np.eye(4)
        turn[:2, :2] = [[np.cos(_HAND_TURN), -np.sin(_HAND_TURN)], [np.sin(_HAND_TURN), np.cos(_HAND_TURN)]]
        flange, laid = links[:, 8], self._hands.X_WM_laid
        board = flange
        if laid is not None:
            board = np.broadcast_to(laid @ np.linalg.inv(self._hands.board.X_FM), flange.shape)
        return {**{name: links[:, i] for name, i in _LINKS.items()}, _HAND: flange @ turn, BODY: board}

    @cached_property
    def _renderer(self) -> Renderer:
        still = [v for v in Cell(self._task, self._arm.world).bodies.visuals if v.body == WORLD]
        return Renderer(self.model(), self._X_WC, [*still, *visuals(), *self._hands.board.visuals()])

    @cached_property
    def _noise(self) -> SensorNoise:
        own = SensorNoise.draw(camera_stream(self._arm.seed), self._sensing.depth_noise_scale)
        shrink = 0.25 if self._sensing.camera == "small" else 1.0
        return replace(own, lens_blur_px=LENS_BLUR_PX * shrink, jpeg_quality=JPEG_QUALITY)

    def _need_connection(self) -> None:
        if not self._connected:
            raise DeviceUnavailable("the lab's camera is not connected: use it inside a `with` block")
