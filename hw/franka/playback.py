"""One motion, cycle by cycle: the next joints to command, when to brake, when it is over. Knows no device.

The path follows the arm's own clock: after a lost cycle the sample that is due comes next, and the missed one is
skipped. After a gap of more than `GAP_S`, or for a step that no joint may make in the time since the last cycle, the
motion ends without another command.

A stop slows the path's time as `hw.braking` does. It begins at the next moment for which a stop within the limits was
computed beforehand, and each cycle computes one sample of it. At the end the last sample is held until the arm stands
still.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from math import inf, isfinite

import numpy as np

from hw.braking import STOPS_EVERY_S, check_braking, joint_spline
from hw.errors import MotionRefused
from hw.franka.driver import FAULT, Failure, Reading, SdkState
from hw.franka.starting import HELD_RAD, START_S
from hw.joint_limits import JointLimits
from hw.limits import START_TOLERANCE_RAD
from hw.motion_limits import MotionLimits
from hw.quantities import QUANTITIES
from hw.types import PATH_RATE_HZ, Array, JointPath
from hw.watchdog import SILENCE_S, since_boot_s

STEP_RAD = 3e-6
"""How far the first command may be from the joints that the arm's controller holds: in one millisecond this is 3 rad/s²
and 3000 rad/s³, which every joint of all arms may do. States in single precision differ by less."""
FADE_TICKS = 500
"""A larger difference fades over this many milliseconds, because a trajectory has to begin at the arm's most recent
`q_d` (control_parameters.rst of the maker's FCI documentation)."""
GAP_S = 0.02
"""The longest time between two cycles, on the arm's clock: the arm stops by itself after 20 lost commands in a row."""
STILL_RAD_S = 0.01
"""A joint slower than this stands still (as `hw.limits.REST_TOLERANCE_RAD_S`)."""

STILL_CYCLES = 20
HOLD_S = 0.5
"""The longest wait for standstill after the last sample."""

NONSENSE = "nonsense"
"""The reason of a stop because the arm reported NaN, or joints that it cannot have."""

RATE_WINDOW = 100
"""Cycles over which the arm computes its success rate, which is meaningless before (libfranka, `RobotState`)."""


@dataclass(frozen=True, eq=False)
class PlayableMotion:
    """A checked path, the moments at which a stop may begin, and the stop from each."""

    path: JointPath
    stop_at: Array  # (K,) rising sample indices at which a stop may begin
    stop_s: Array  # (K,) duration of the stop
    slowed_s: Array  # (K, M) path time in each millisecond of the stop
    joints: JointLimits
    checked_s: float = -inf  # the stamp of the reading that it was checked with; before every reading: it never begins


def motion_of(path: JointPath, limits: MotionLimits) -> PlayableMotion:
    """Raises MotionRefused if the path has a moment at which no stop keeps the limits."""
    stops = check_braking(path, limits, STOPS_EVERY_S)
    finite = np.isfinite(stops.duration_s)
    at = np.rint(stops.at_s[finite] * PATH_RATE_HZ)
    if not finite[-1] or np.diff(at, prepend=0.0).max() > 2.0 * STOPS_EVERY_S * PATH_RATE_HZ:
        raise MotionRefused(
            f"{limits.model}: from some moments, no stop that begins within {2e3 * STOPS_EVERY_S:.0f} ms keeps all "
            "limits; slow the path down"
        )
    return PlayableMotion(path, at, stops.duration_s[finite], stops.path_time_s[finite], limits.joints)


@dataclass(frozen=True, eq=False)
class Played:
    """The log of a motion, up to standstill or to the fault that ended it: commanded and measured values."""

    t_s: Array  # (M,) the arm's clock since its first cycle
    clock_s: Array  # (M,) the computer's clock when each cycle was answered
    q_commanded_rad: Array  # (M, 7)
    q_measured_rad: Array  # (M, 7)
    dq_measured_rad_s: Array  # (M, 7)
    answered: float  # share of the arm's cycles that got an answer
    reported: float  # mean of the arm's own success rate; 1 until it is meaningful
    stop_wanted: str = ""  # why it braked; empty: it did not
    wanted_at: int = -1  # row at which the stop was requested
    braked_at: int = -1  # row of the first slowed sample
    measured: dict[str, Array] = field(default_factory=dict)
    """(M, K) by the names of `hw.quantities.QUANTITIES`: what the arm reported. NaN where it reported nonsense."""

    @property
    def success_rate(self) -> float:
        """Share of the cycles that the arm answered in time: the lower of our count and the arm's own."""
        return min(self.answered, self.reported)


class Playback:
    """`step` is called in every cycle of the arm. `stop_reason` returns the reason to stop now, or "".

    `interrupted` gets the state of the first cycle, and returns why the motion may no longer begin, or "". `sent_s` is
    when the program sent the motion, on the clock `awake`; None: now. `held_rad` is how far the held joints may be from
    the first sample; the difference fades.
    """

    def __init__(
        self,
        motion: PlayableMotion,
        stop_reason: Callable[[], str],
        clock: Callable[[], float],
        start_s: float = START_S,
        awake: Callable[[], float] = since_boot_s,
        interrupted: Callable[[SdkState], str] = lambda state: "",
        sent_s: float | None = None,
        held_rad: float = HELD_RAD,
    ) -> None:
        self._motion, self._wanted, self._clock = motion, stop_reason, clock
        self._start_s, self._awake, self._sent_s = start_s, awake, awake() if sent_s is None else sent_s
        self._interrupted = interrupted
        self._held_rad, self._off_rad = held_rad, list[float]()  # fading: what the first sample was away
        self.refused = ""  # why not even the first sample was commanded
        self._fastest = motion.joints.dq_max_rad_s.tolist()
        low_rad, high_rad = motion.joints.plausible_rad
        self._low, self._high = low_rad.tolist(), high_rad.tolist()
        self._commanded = list[float]()
        self._samples = motion.path.q_rad.tolist()  # commanded unless it brakes
        self._last = len(self._samples) - 1  # tick of the last sample, of the path or of its stop
        self._between = _Between(motion.path)
        self._stop_at, self._stop_ticks = motion.stop_at.astype(int).tolist(), _ticks(motion.stop_s)
        self._all_slowed, self._slowed = PATH_RATE_HZ * motion.slowed_s, list[float]()  # in samples
        longest = len(self._samples) + round((HOLD_S + motion.stop_s.max()) * PATH_RATE_HZ) + 2
        self._t, self._clock_s = np.zeros(longest), np.zeros(longest)
        self._q_c, self._q, self._dq = (np.zeros((longest, 7)) for _ in range(3))
        self._measured = {quantity: np.zeros((longest, quantity.size)) for quantity in QUANTITIES}
        self._reported: list[tuple[str, Array]] | None = None  # field of a state, log; None: no state has come
        self._tick = self._rows = self._still = 0
        self._rate_sum, self._rate_count = 0.0, 0
        self._reason, self._wanted_at, self._braked_at, self._stop_tick = "", -1, -1, -1

    def step(self, state: SdkState, dt_s: float) -> tuple[list[float], bool]:
        """`hw.franka.driver.Step`. If the arm is no longer at the first sample, the motion ends where the arm is.

        Raises Failure after a gap, and instead of a step beyond the joints' velocities.
        """
        if not self._rows and (stale := self._stale(state)):
            self.refused = stale
            return list(state.q_d), True
        row = self._rows
        if row:
            self._tick += _elapsed(dt_s)
        else:
            off_rad = [held - q for held, q in zip(state.q_d, self._samples[0], strict=True)]
            self._off_rad = off_rad if max(map(abs, off_rad)) > STEP_RAD else []
        tick = self._tick
        nonsense = _nonsense(state, self._low, self._high)
        if not self._reason:
            self._reason = (self._wanted() if tick < self._last else "") or nonsense
            if self._reason:
                self._wanted_at = row
                self._brake(tick)
        last = self._last
        if 0 <= self._stop_tick < tick:
            q = self._between.at(self._slowed[min(tick, last) - self._stop_tick])
            if self._braked_at < 0:
                self._braked_at = row
        else:
            q = self._samples[min(tick, last)]
        fading = bool(self._off_rad) and tick < FADE_TICKS
        if fading:
            left = _left(tick / FADE_TICKS)
            q = [at + left * off for at, off in zip(q, self._off_rad, strict=True)]
        if row:
            self._refuse_jump(q, dt_s)
        self._commanded = q
        self._t[row], self._clock_s[row], self._q_c[row] = tick / PATH_RATE_HZ, self._clock(), q
        self._q[row], self._dq[row] = state.q, state.dq
        self._measure(row, state)
        self._rows = row + 1
        if row >= RATE_WINDOW:
            self._rate_sum += state.control_command_success_rate
            self._rate_count += 1
        return q, tick >= last and not fading and self._stands(row, tick - last)

    def _measure(self, row: int, state: SdkState) -> None:
        """Log every quantity that the arm reports."""
        if self._reported is None:
            self._measured = {one: log for one, log in self._measured.items() if hasattr(state, one.state)}
            self._reported = [(one.state, log) for one, log in self._measured.items()]
        for name, log in self._reported:
            log[row] = getattr(state, name)

    def played(self) -> Played:
        """The log so far."""
        n = self._rows
        elapsed = self._tick + 1 if n else 1
        reported = self._rate_sum / self._rate_count if self._rate_count else 1.0
        commanded, measured, speeds = self._q_c[:n], self._q[:n], np.nan_to_num(self._dq[:n])
        real = ((measured >= self._low) & (measured <= self._high)).all(axis=1, keepdims=True)
        measured = np.where(real, measured, commanded)  # it braked where the arm reported nonsense
        logs = (self._t[:n], self._clock_s[:n], commanded, measured, speeds)
        stop = (self._reason, self._wanted_at, self._braked_at)
        values = {quantity.name: log[:n] for quantity, log in self._measured.items()} if n else {}
        return Played(*logs, n / elapsed, reported, *stop, values)

    def _stale(self, state: SdkState) -> str:
        """Why the motion may not begin in this first cycle, or ""."""
        if why := self._interrupted(state):
            return why
        first, late_s = self._samples[0], self._awake() - self._sent_s
        if late_s > self._start_s:
            return f"the arm took {late_s:.1f} s to begin the motion (at most {self._start_s:g} s)"
        for joints, most_rad, what in (
            (state.q_d, self._held_rad, "holds"),
            (state.q, START_TOLERANCE_RAD, "reports"),
        ):
            off_rad = [abs(now - q) for now, q in zip(joints, first, strict=True)]
            if not max(off_rad) <= most_rad:
                joint = off_rad.index(max(off_rad))
                return (
                    f"since the motion was checked the arm has moved: it {what} joint {joint + 1} "
                    f"{off_rad[joint]:.3g} rad from the beginning (at most {most_rad:g} rad)"
                )
        return ""

    def _refuse_jump(self, q_rad: list[float], dt_s: float) -> None:
        """Raises Failure if a joint would be faster from the last command to this one than it may ever be."""
        for joint, (now, last, most) in enumerate(zip(q_rad, self._commanded, self._fastest, strict=True)):
            if not abs(now - last) <= most * dt_s:
                raise Failure(
                    FAULT,
                    f"the next command would move joint {joint + 1} by {abs(now - last):.4g} rad in "
                    f"{1e3 * dt_s:.0f} ms (at most {most * dt_s:.4g} rad); it was not sent, and the arm's controller "
                    f"braked. {_REPORT}",
                )

    def _brake(self, tick: int) -> None:
        i = bisect_left(self._stop_at, tick + 1)
        if i == len(self._stop_at):  # the end comes before the next moment to brake
            return
        self._stop_tick = self._stop_at[i]
        slowed = self._all_slowed[i].tolist()
        self._slowed = [*slowed, slowed[-1]]
        self._last = self._stop_tick + self._stop_ticks[i] + 1  # in the last millisecond of a stop it still moves

    def _stands(self, row: int, held: int) -> bool:
        still = max(map(abs, self._dq[row].tolist())) < STILL_RAD_S
        self._still = self._still + 1 if still else 0
        return self._still >= STILL_CYCLES or held >= HOLD_S * PATH_RATE_HZ


_REPORT = "Keep the session's record and report this"


def _nonsense(state: SdkState, low_rad: Sequence[float], high_rad: Sequence[float]) -> str:
    """`NONSENSE` if the arm reports NaN, or joints that it cannot have; else ""."""
    plausible = all(low <= q <= high for q, low, high in zip(state.q, low_rad, high_rad, strict=True))
    return "" if plausible and isfinite(sum(state.dq)) else NONSENSE


def _elapsed(dt_s: float) -> int:
    """Milliseconds of the path in the time since the last cycle. Raises Failure for a gap, and for a clock that stands
    still.
    """
    if 0.0 < dt_s < GAP_S + 0.0005:
        return round(dt_s * PATH_RATE_HZ)
    if dt_s > 0.0:
        raise Failure(
            FAULT,
            f"{1e3 * dt_s:.0f} ms of the arm's clock passed between two cycles (at most {1e3 * GAP_S:.0f} ms); nothing "
            "was commanded after that, and the arm's controller braked. Check real-time kernel, rtprio, CPU governor "
            "and cable (docs/guide/arms.md), and end other programs",
        )
    raise Failure(
        FAULT,
        f"the arm's clock went on by {1e3 * dt_s:.0f} ms between two cycles (it has to advance); nothing was commanded "
        f"after that, and the arm's controller braked. {_REPORT}",
    )


def _left(u: float) -> float:
    """The share that is left of a fading difference; at rest at both ends, without acceleration or jerk."""
    return 1.0 - u**4 * (35.0 - 84.0 * u + 70.0 * u**2 - 20.0 * u**3)


def _ticks(duration_s: Array) -> list[int]:
    return [round(one * PATH_RATE_HZ) for one in duration_s.tolist()]


class _Between:
    """A path between its samples: `hw.braking.joint_spline`, one moment at a time, in plain floats."""

    def __init__(self, path: JointPath) -> None:
        spline = joint_spline(path)
        scaled = spline.c / PATH_RATE_HZ ** np.arange(3, -1, -1)[:, None, None]
        self._pieces: list[list[list[float]]] = np.moveaxis(
            scaled, 0, -1
        ).tolist()  # per piece and joint: the factors of u³, u², u, 1
        self._end: list[float] = path.q_rad[-1].tolist()

    def at(self, sample: float) -> list[float]:
        """The joints (7,) at a path time in samples, held at the end."""
        piece = int(sample)
        if piece >= len(self._pieces):
            return self._end
        u = sample - piece
        return [((a * u + b) * u + c) * u + d for a, b, c, d in self._pieces[piece]]


@dataclass(frozen=True)
class Timing:
    """The player's limits of time. Only tests change the defaults."""

    realtime: bool = True  # demand a real-time kernel and priority
    silence_s: float = SILENCE_S  # longest silence of the program during a motion, as of the pedal
    start_s: float | None = None  # None: as the settings of the arm say, like the next
    unwatched_s: float | None = None
    overrun_s: float = 5.0  # how long after its end a motion may go unanswered


@dataclass(frozen=True)
class Rhythm:
    """The regularity with which the arm's states arrived."""

    states: int
    missed: int  # milliseconds of the arm's clock without one
    longest_gap_s: float  # on the computer's clock
    interface: (
        int | None
    )  # version of the arm's server; None: the SDK does not report it, and has refused any but its own
    priority: int  # real-time priority of the process that took them; 0: none


@dataclass(frozen=True, eq=False)
class PlayOutcome:
    """The result of a motion: the log, and the failure that ended it, if one did."""

    played: Played
    failure: Failure | None = None
    rest: tuple[Reading, ...] = ()  # where the arm stopped by itself: one a millisecond, until it stood still
