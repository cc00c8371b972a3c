"""The Franka Hand behind `hw.ports.Hand`, through the SDK of either arm: both have the same interface to it.

`python -m hw.franka.hand`, started by `hw.franka.hand_keeper`, is a process with one connection to the hand. An SDK may
hold Python's global lock until the fingers stand still, which can take minutes. Nothing else runs in this process, and
the system ends it with its keeper.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from multiprocessing.connection import Connection
from typing import Any, Self

from hw.child import Call
from hw.errors import DeviceUnavailable, HandError
from hw.franka.hand_stop import Stopped, Widths
from hw.franka.versions import PACKAGES, load
from hw.grasping import TOLERANCE_M, narrower_m
from hw.types import HandState
from hw.watchdog import die_with_parent

SPEED_M_S = 0.03
"""Speed of the fingers: slow enough to pull a hand away."""
STRONGEST_N = 70.0
"""The hand's continuous grasping force (the maker's data sheet)."""
STEPS_OF_WIDTH_M = 0.002
"""A width that differs by more than this from the request is an error."""

Sdk = Callable[[], Any]
"""Imports the module of an SDK; raises DeviceUnavailable where it is not installed."""


OPEN, STATE, WIDTHS, GRASP = "open", "state", "widths", "grasp"
"""Calls to this process. The first three move nothing. `home`, `move` and `stop` are called by their own names."""


class NothingGrasped(HandError):
    """The hand closed, and nothing of the expected width was between its fingers.

    The width that the hand reports afterwards is not evidence, because it may have opened again.
    """


Answer = HandState | HandError | DeviceUnavailable | Stopped | Widths
"""The answer to a call; that to `WIDTHS` has rows. A HandError says that the call failed, DeviceUnavailable that the
hand is lost."""


class FrankaHand:
    """Entering connects; every command returns once the fingers stand still."""

    def __init__(self, host: str, sdk: Sdk) -> None:
        """`host` is the arm's address."""
        self._host, self._load = host, sdk
        self._gripper: Any = None
        self._errors: tuple[type[Exception], ...] = (RuntimeError,)
        self._homed = False

    def __enter__(self) -> Self:
        sdk = self._load()
        # The errors of both SDKs. Of these, only pylibfranka's version mismatch is not a RuntimeError.
        self._errors = (RuntimeError, getattr(sdk, "FrankaException", RuntimeError))
        try:
            self._gripper = sdk.Gripper(self._host)
        except self._errors as error:
            raise DeviceUnavailable(
                f"the hand at {self._host} does not answer ({error}): switch the arm on and activate FCI in Desk; "
                "is the hand mounted, initialised there, and not used by another program?"
            ) from error
        return self

    def __exit__(self, *exc: object) -> None:
        self._gripper, self._homed = None, False

    def state(self) -> HandState:
        """See `hw.ports.Hand`."""
        now = self._read()
        try:
            return HandState(float(now.width), bool(now.is_grasped), self._homed)
        except ValueError as error:
            raise DeviceUnavailable(f"the hand at {self._host} reports nonsense ({error})") from error

    def home(self) -> None:
        """See `hw.ports.Hand`."""
        self._did(self._connected().homing, "could not be homed; take everything out of it and home it again")
        self._homed = True

    def move(self, width_m: float) -> None:
        """See `hw.ports.Hand`."""
        self._need_homing()
        widest_m = float(self._read().max_width)
        if not 0.0 <= width_m <= widest_m:
            raise HandError(
                f"the fingers cannot open to {1e3 * width_m:.1f} mm: the range is 0 to {1e3 * widest_m:.1f} mm"
            )
        gripper = self._connected()
        self._did(lambda: gripper.move(width_m, SPEED_M_S), f"did not reach {1e3 * width_m:.1f} mm")
        stands_m = float(self._read().width)
        if abs(stands_m - width_m) > STEPS_OF_WIDTH_M:
            raise HandError(
                f"the fingers are {1e3 * stands_m:.1f} mm apart instead of {1e3 * width_m:.1f} mm: something is "
                "between them; take it out, or grasp it"
            )

    def grasp(self, width_m: float, force_N: float) -> None:
        """See `hw.ports.Hand`."""
        self._need_homing()
        if not 0.0 < force_N <= STRONGEST_N:
            raise HandError(f"a grasp force of {force_N:g} N: it must be above 0 and at most {STRONGEST_N:g} N")
        gripper = self._connected()
        why = f"did not find anything {1e3 * width_m:.1f} mm wide: hold the tool's handle between the fingers"
        inner_m = narrower_m(width_m)
        self._did(lambda: gripper.grasp(width_m, SPEED_M_S, force_N, inner_m, TOLERANCE_M), why, NothingGrasped)
        if not self._read().is_grasped:
            raise HandError("the hand closed, but reports that it holds nothing; hand the tool over again")

    def widths(self, over: Callable[[], bool]) -> Widths:
        """Read the width again and again until `over()`, with the times (`time.monotonic`) at which it came."""
        rows, ends = [self._timed_width()], False
        while not ends:
            ends = over()  # before the last row, which shows fingers that stayed where they had closed
            rows.append(self._timed_width())
        return rows

    def _timed_width(self) -> tuple[float, float]:
        width_m = self.state().width_m
        return time.monotonic(), width_m

    def stop(self) -> None:
        """End a motion of the fingers that another connection has begun. Raises DeviceUnavailable."""
        gripper = self._connected()
        try:
            gripper.stop()
        except self._errors as error:
            raise DeviceUnavailable(f"the hand at {self._host} does not take a stop ({error})") from error

    def _did(self, command: Callable[[], bool], why: str, kind: type[HandError] = HandError) -> None:
        try:
            is_finished = command()
        except self._errors as error:
            raise HandError(f"the hand stopped ({error}); look at it, home it, and run again") from error
        if not is_finished:
            raise kind(f"the hand {why}")

    def _read(self) -> Any:
        gripper = self._connected()
        try:
            return gripper.read_once()
        except self._errors as error:
            raise DeviceUnavailable(f"the hand at {self._host} no longer answers ({error})") from error

    def _need_homing(self) -> None:
        self._connected()
        if not self._homed:
            raise HandError("the hand has not been homed since the program connected; empty it and home it first")

    def _connected(self) -> Any:
        if self._gripper is None:
            raise DeviceUnavailable("the hand is not connected: use it inside a `with` block")
        return self._gripper


def serve(keeper: Connection) -> None:
    """Answer calls, each with the hand's state or its error, until the keeper hangs up."""
    hand: FrankaHand | None = None
    with suppress(EOFError, OSError):
        while True:
            call: Call = keeper.recv()
            answer: Answer
            try:
                if call.method == OPEN:
                    model, host = call.arguments
                    hand = FrankaHand(host, partial(load, PACKAGES[model]))
                    hand.__enter__()
                assert hand is not None, "it is opened first"
                if call.method == WIDTHS:
                    answer = hand.widths(keeper.poll)
                else:
                    if call.method not in (OPEN, STATE):
                        getattr(hand, call.method)(*call.arguments)
                    answer = hand.state()
            except (HandError, DeviceUnavailable) as error:
                answer = error
            keeper.send(answer)


def main(connection_fd: str, _pipe_fd: str, parent: str) -> None:
    """Serve one keeper; the arguments are file descriptors and the keeper's process."""
    die_with_parent(int(parent))
    with Connection(int(connection_fd)) as keeper:
        serve(keeper)


if __name__ == "__main__":
    main(*sys.argv[1:])
