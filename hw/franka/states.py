"""Reads the states of a connected arm, so that no old state passes for the present one and none is missed.

An arm sends a state every millisecond. While nobody reads, the socket keeps the *oldest* 48 to 92 of them and drops all
that come later; libfranka's `readOnce` then returns the newest of those that were kept. So after a pause the first
state is as old as the pause is long.
"""

from __future__ import annotations

from collections.abc import Callable
from math import inf
from typing import Any

from hw.franka import reflexes
from hw.franka.driver import LOST, Failure, SdkState, error_names, mode_name
from hw.franka.starting import UNWATCHED_S

UNREAD_S = 0.02
"""Longest pause (computer's clock) after which the socket cannot be full, so that the next state is the newest."""

WAITED_SHARE = 0.3
"""The program waited for a state if reading it took at least this share of the time between it and the state before."""

WAITED_FOR = 3
"""After waiting for this many states in a row, the socket is empty. A computer that stalls can imitate one such
wait."""

MOST_STATES = 2000
CALM = ("Idle", "Move", "AutomaticErrorRecovery")
"""Modes that need no person, because the last motion is still ending, or a recovery follows a reflex."""


class States:
    """Reads an SDK's robot. `next` and `present` raise the SDK's errors."""

    def __init__(self, robot: Any, clock: Callable[[], float], unwatched_s: float = UNWATCHED_S) -> None:
        self._robot, self._clock, self._unwatched_s = robot, clock, unwatched_s
        self._read_s = self._at_s = -inf  # of the last state: when it was read; its stamp
        self._disturbed_s, self._disturbance = -inf, ""  # the last state that was not calm
        self.longest_s = 0.0  # pause between two states, since somebody set this to 0
        self._resumed_s, self._unwatched = -inf, 0.0  # the first state after the last pause; the pause

    def next(self) -> SdkState:
        """The next state in the socket. It is the present one if the last state was read within `UNREAD_S`."""
        state = self._robot.read_once()
        self._read_s = self._clock()
        self.note(state)
        return state

    def present(self) -> SdkState:
        """A state that the arm sent after this call began. Raises Failure if the computer cannot keep up."""
        before_s = self._read_s
        state = self.next()
        if self._read_s - before_s <= UNREAD_S:
            return state
        waited = 0
        for _ in range(MOST_STATES):
            at_s, read_s = self._at_s, self._read_s
            state = self.next()
            newer_s = self._at_s - at_s
            waited = waited + 1 if newer_s > 0.0 and self._read_s - read_s >= WAITED_SHARE * newer_s else 0
            if waited == WAITED_FOR:
                return state
        raise Failure(
            LOST,
            f"after {MOST_STATES} states of the arm none is known to be a present one: end other programs, check the "
            "network (docs/guide/arms.md)",
        )

    def note(self, state: SdkState) -> None:
        """Remember a state that was read: whether it is calm, and how long nobody had read one."""
        at_s = state.time.to_sec()
        if self._at_s > -inf:
            self.longest_s = max(self.longest_s, at_s - self._at_s)
        if not 0.0 <= at_s - self._at_s <= self._unwatched_s:
            self._resumed_s, self._unwatched = at_s, at_s - self._at_s
        self._at_s = at_s
        mode = mode_name(state.robot_mode)
        if mode not in CALM or state.current_errors:
            reasons = reflexes.in_words(error_names(state.current_errors))
            self._disturbed_s = at_s
            self._disturbance = "; ".join(filter(None, (reflexes.of_mode(mode), reasons)))

    def since(self, checked_s: float) -> str:
        """Why a motion that was checked at this time of the arm's clock may not begin; "" if it may."""
        if self._disturbed_s > checked_s:
            return f"since the motion was checked: {self._disturbance}"
        if self._resumed_s > checked_s:
            return (
                f"since the motion was checked nobody read the arm's state for {self._unwatched:.2g} s (at most "
                f"{self._unwatched_s:g} s), so a pressed stop button may have been missed; if this comes at every "
                "motion, adaptsim doctor --measure proposes another unwatched_s"
            )
        return ""
