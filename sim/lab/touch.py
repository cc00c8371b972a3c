"""The lab during a touch-off: an arm with a sense of touch, a hand, and a displaced table and tool.

The world is that of `SimulatedLab`: its `[mount]`, the task's own effects on the tool, its joint zeros.
"""

from __future__ import annotations

from typing import Any, Self

import numpy as np

from hw.braking import brake
from hw.collision import KeepOut
from hw.contact import RIPPLE_NM, RIPPLE_PER_RAD, TORQUE_NOISE_NM, Detector
from hw.errors import ArmFault, MotionRefused, NoContact, StoppedByPedal
from hw.grasping import FakeHand
from hw.kinematics import forward
from hw.types import PATH_RATE_HZ, Array, Contact, Execution, Guard, JointPath, frozen_array
from hw.workcell import Workcell, refuse_unless_safe, refuse_while_stopped, require_guarded
from sim.lab.arm import ArmInLab
from sim.lab.rng_streams import REPEATABILITY_RAD, guided_stream, joint_zeros, touch_stream
from sim.lab.setting_down import set_down_q_rad
from sim.lab.touch_cell import Felt, TouchCell
from sim.lab.world import World
from sim.panda.setting_down import SetDown
from sim.panda.tool import FINGERTIPS, empty_hand, feeling, touchable
from sim.tasks.task import Task

GUIDING_S = 15.0
"""The time that a person takes for one set-down."""
PIECE_S = 0.04
"""The plant advances in pieces of this length; after each piece the guard checks for a touch."""

BIAS_NM = 0.5
"""Error of the torque estimate that is constant during a motion. Ripple of the gears and white noise are those of
`hw.fake`.
"""
SPIKE_NM, SPIKES_PER_S = 6.0, 0.5


class TouchLab:
    """One world as a bench for a touch-off. Entering connects arm and hand; equal inputs give equal numbers."""

    def __init__(
        self,
        task: Task,
        world: World,
        seed: int,
        cell: Workcell,
        *,
        home_q_rad: Array,
        things: tuple[KeepOut, ...] = (),
    ) -> None:
        """`home_q_rad` (7,) is the arm's first posture.

        `cell` checks its motions, with the tool that the hand holds at each moment. `things` are boxes left on the
        table.

        Raises NoHardware, and UnknownName for a tool without feelers. Builds nothing yet.
        """
        world.require_lab()
        self._task, self._world = task, world
        self.hand = FakeHand()
        self.arm = _FeelingArm(task, world, seed, self.hand, frozen_array(home_q_rad, (7,)), cell, things)

    def __enter__(self) -> Self:
        self.arm.__enter__()
        self.hand.__enter__()
        return self

    def __exit__(self, *exc: object) -> None:
        self.hand.__exit__(*exc)
        self.arm.__exit__(*exc)

    def offer_tool(self, present: bool) -> None:
        """The simulated person holds the tool between the open fingers (True), or takes it away."""
        self.hand.between_m = touchable(self._task.require_hardware()).held_m if present else None
        self.hand.holds = self.hand.holds and present

    def set_down(self, where: SetDown, number: int) -> None:
        """The simulated person guides the tool to a set-down of the given number, as exactly as a hand can.

        Raises SimError out of reach.
        """
        self.offer_tool(True)
        self.arm.be_guided(where)

    def truth(self) -> dict[str, Any]:
        """The true values that a touch-off should find, only for checks.

        They include slip, because they describe the tool's present pose.
        """
        mount = self._world.mount
        table = mount.true.table
        return {
            "table": [table.height_m, table.slope_x, table.slope_y],
            "tool_height_m": 1e-3 * mount.tool_height_mm,
            "tool_pitch_rad": float(getattr(self._world.unmodelled, "pitch_bias_rad", 0.0)),
            "tool_roll_rad": 1e-3 * mount.tool_roll_mrad,
            "tool_slipped_rad": self.arm.slipped_rad,
            "joint_zeros_rad": self.arm.zeros_rad.tolist(),
        }


class _FeelingArm(ArmInLab):
    """`hw.ports.GuardedArm`.

    Guarded motions have physics; free motions are exact, and a collision in one is a fault.
    """

    def __init__(
        self,
        task: Task,
        world: World,
        seed: int,
        hand: FakeHand,
        home_q_rad: Array,
        cell: Workcell,
        things: tuple[KeepOut, ...],
    ) -> None:
        super().__init__(cell, "run again")
        self._task, self._world, self._seed, self._hand = task, world, seed, hand
        self._hardware = task.require_hardware()
        self._feelers = touchable(self._hardware).feelers
        self._things, self._q_rad = things, home_q_rad
        self.zeros_rad = joint_zeros(seed, world.sensing.joint_offset_mrad)
        self._phase_rad = touch_stream(seed, 0).uniform(0.0, 2.0 * np.pi, 7)
        self._t_s, self._touches, self._guided = 0.0, 0, 0
        self._plants: dict[bool, TouchCell] = {}

    @property
    def slipped_rad(self) -> float:
        return self._plants[True].turned_rad if True in self._plants else 0.0

    def _now(self) -> tuple[float, Array]:
        return self._t_s, self._q_rad

    def be_guided(self, where: SetDown) -> None:
        """Be where a person sets the tool down."""
        self._guided += 1
        rng = guided_stream(self._seed, self._guided)
        true = self._cell.arm.in_true_joints()
        q_rad = set_down_q_rad(where, self._world, self._hardware.X_FT, true, self._q_rad, rng)
        self._q_rad = frozen_array(q_rad - self.zeros_rad)
        self._t_s += GUIDING_S

    def execute(self, path: JointPath) -> Execution:
        self.need_connection()
        refuse_unless_safe(path, self._workcell_now, self._q_rad, fault=self._fault)
        if path.contact is not None:
            raise MotionRefused("a touch-off has no object to act on: only guarded motions may touch")
        knock = self._knocks(path)
        last = len(path.t_s) - 1 if knock is None else knock
        t_start_s = self._moved_to(path.q_rad[last], float(path.t_s[last]))
        if knock is not None:
            raise self._stopped(ArmFault, f"reflex {path.t_s[knock]:.2f} s into the path: the tool hit the table")
        return Execution(t_start_s, path.t_s, path.q_rad, path.q_rad, 1.0)

    def execute_until_contact(self, path: JointPath, guard: Guard) -> Contact:
        self.need_connection()
        refuse_while_stopped(self._fault)
        require_guarded(path, guard, self._workcell_now, self._q_rad)
        self._touches += 1
        faults = self._world.faults
        if self._touches in faults.pedal_release:
            braked = brake(path, path.duration_s / 2.0, self._cell.motion)
            self._moved_to(braked.q_rad[-1], braked.duration_s)
            raise self._stopped(StoppedByPedal, f"the pedal was released {path.duration_s / 2.0:.2f} s into the path")
        if self._touches in faults.arm_reflex:
            half = len(path.t_s) // 2
            self._moved_to(path.q_rad[half], float(path.t_s[half]))
            why = f"reflex {path.t_s[half]:.2f} s into the path: an external force was too large"
            raise self._stopped(ArmFault, why)
        contact = self._feel(path, guard)
        there_s = path.duration_s if contact is None else contact.t_s
        self._t_s += 2.0 * there_s  # there and back
        if contact is None:
            raise NoContact(
                f"the arm came down to the end of its path, {path.duration_s:.1f} s, and touched nothing; it is back "
                "at the start"
            )
        return contact

    def _feel(self, path: JointPath, guard: Guard) -> Contact | None:
        """Move down with physics until it touches and stands still; the way back needs no physics."""
        rng = touch_stream(self._seed, self._touches)
        unseen = self.zeros_rad + REPEATABILITY_RAD * rng.standard_normal(7)
        cell, detector = self._plant(), Detector(guard)
        cell.start(_moved(path, unseen))
        pieces: list[Felt] = []
        bias_Nm = BIAS_NM * rng.standard_normal(7)
        while (until_s := PIECE_S * (len(pieces) + 1)) <= path.duration_s + PIECE_S:
            try:
                felt = cell.advance(until_s)
            except RuntimeError as error:
                raise self._stopped(ArmFault, f"the lab's simulation failed: {error}") from error
            pieces.append(self._measured(felt, unseen, bias_Nm, rng))
            at = detector.feed(pieces[-1].t_s, pieces[-1].q_rad, pieces[-1].torque_Nm)
            if at is not None:
                stop_s = float(pieces[-1].t_s[-1])
                braked = brake(path, stop_s, self._cell.motion)
                cell.follow(_moved(braked, unseen))
                last = cell.advance(PIECE_S * np.ceil((braked.duration_s + 0.1) / PIECE_S))
                after = self._measured(last, unseen, bias_Nm, rng)
                detector.feed(after.t_s, after.q_rad, after.torque_Nm)
                return _contact(pieces, at, detector.largest_N)
        return None

    def _measured(self, felt: Felt, unseen: Array, bias_Nm: Array, rng: np.random.Generator) -> Felt:
        """The readings that the arm reports: without the joint zeros, with sensor errors."""
        noise = TORQUE_NOISE_NM * rng.standard_normal(felt.torque_Nm.shape)
        spikes = rng.uniform(size=len(felt.t_s)) < SPIKES_PER_S / PATH_RATE_HZ
        noise[spikes] += SPIKE_NM * rng.choice([-1.0, 1.0], size=(int(spikes.sum()), 7))
        ripple = RIPPLE_NM * np.sin(RIPPLE_PER_RAD * felt.q_rad + self._phase_rad)
        return Felt(
            felt.t_s, felt.commanded_rad - unseen, felt.q_rad - unseen, felt.torque_Nm + noise + ripple + bias_Nm
        )

    def _knocks(self, path: JointPath) -> int | None:
        """The first sample at which the tool is below the true table."""
        table = self._world.mount.true.table
        feelers = self._feelers if self._hand.holds else (FINGERTIPS,)
        X_FT = self._world.mount.true.X_FT(self._hardware.X_FT) if self._hand.holds else np.eye(4)
        X_BT = forward(path.q_rad[::20] + self.zeros_rad) @ X_FT
        for feeler in feelers:
            p_m = X_BT[:, :3, :3] @ feeler.p_T_m + X_BT[:, :3, 3]
            below = np.flatnonzero(p_m[:, 2] - feeler.radius_m < table.height_at(p_m) - 1e-3)
            if len(below):
                return 20 * int(below[0])
        return None

    def _plant(self) -> TouchCell:
        holds = self._hand.holds
        if holds not in self._plants:
            feelers = self._feelers if holds else None
            self._plants[holds] = TouchCell(self._task, self._world, feelers, self._things)
        self._plants[holds].holds_at_most(self._world.mount.grip_Nm_per_N * self._hand.force_N)
        return self._plants[holds]

    @property
    def _workcell_now(self) -> Workcell:
        """The workcell with the tool that the arm assumes in the hand."""
        return self._cell.holding(feeling(self._hardware) if self._hand.holds else empty_hand())

    def _moved_to(self, q_rad: Array, duration_s: float) -> float:
        t_start_s, self._t_s = self._t_s, self._t_s + duration_s
        self._q_rad = frozen_array(q_rad)
        return t_start_s


def _moved(path: JointPath, by_rad: Array) -> JointPath:
    return JointPath(path.t_s, path.q_rad + by_rad)


def _contact(pieces: list[Felt], at: int, largest_N: float) -> Contact:
    """The contact from the felt pieces; `at` is an index into the last piece."""
    end = sum(len(piece.t_s) for piece in pieces[:-1]) + at + 1
    t_s, commanded, measured, torque = (
        np.concatenate([getattr(piece, name) for piece in pieces])[:end]
        for name in ("t_s", "commanded_rad", "q_rad", "torque_Nm")
    )
    return Contact(float(t_s[-1]), measured[-1], largest_N, t_s, commanded, measured, torque)
