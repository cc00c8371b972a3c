"""The program's end of the player process (`hw.franka.player`), and the doctor's look through it at an arm at rest."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Protocol

from hw.child import Call, Child, ChildGone
from hw.errors import DeviceUnavailable
from hw.franka.driver import LOST, Failure, Reading
from hw.franka.identity import ArmReport
from hw.franka.playback import HOLD_S, PlayableMotion, PlayOutcome, Rhythm, Timing
from hw.franka.player import CONNECT, PLAY
from hw.franka.settings import FrankaSettings, Payload
from hw.franka.starting import Rehearsal
from hw.watchdog import WORD_EVERY_S, since_boot_s

ANSWER_S = 60.0
"""The longest wait for anything but a motion: the start of the process, and libfranka, which is slow to give up."""


class Player(Protocol):
    """The requests to the process that plays motions (`hw.franka.process.PlayerProcess`). All raise Failure."""

    @property
    def alive(self) -> bool:
        """Whether its process runs."""

    @property
    def notes(self) -> tuple[str, ...]:
        """One sentence for each real-time property that the computer does not grant the process."""

    def reading(self) -> Reading:
        """The arm's present report."""

    def report(self) -> ArmReport:
        """The arm's description of itself, with its masses."""

    def recover(self) -> Reading:
        """Clear a fault, and return the arm's report after that."""

    def carry(self, payload: Payload) -> Reading:
        """Set the load of the hand, and return the arm's report after that."""

    def play(self, motion: PlayableMotion, word: Callable[[], bytes]) -> PlayOutcome:
        """Play `motion`; `word` is asked every few milliseconds whether it may go on."""

    def close(self) -> None:
        """End the process; the arm stops if it moves."""


class PlayerProcess:
    """A running player. `pid` is its process; every method raises Failure once it is gone."""

    def __init__(self, model: str, settings: FrankaSettings, timing: Timing | None = None) -> None:
        """Start the process and connect to the arm. Raises Failure."""
        self._timing = timing = timing or Timing()
        self._child = Child("hw.franka.player", str(timing.silence_s))
        self._asking = threading.Lock()
        try:
            silent = (
                f"{model} at {settings.host} accepts the connection and then does not answer: if another program, on "
                "any computer, is connected to the arm, end that one; otherwise restart the arm"
            )
            self._notes: tuple[str, ...] = self._ask(Call(CONNECT, (model, settings, timing)), silent)
        except Failure:
            self.close()
            raise

    @property
    def pid(self) -> int:
        """The process number."""
        return self._child.pid

    @property
    def alive(self) -> bool:
        """See `Player`."""
        return self._child.alive

    @property
    def notes(self) -> tuple[str, ...]:
        """See `Player`."""
        return self._notes

    def listen(self, states: int) -> Rhythm:
        """Read `states` states as they come; nothing moves."""
        rhythm: Rhythm = self._ask(Call("listen", (states,)))
        return rhythm

    def rehearse(self, starts: int, readings: int) -> Rehearsal:
        """See `hw.franka.connection.Connection`."""
        rehearsal: Rehearsal = self._ask(Call("rehearse", (starts, readings)), within_s=ANSWER_S + 1e-3 * readings)
        return rehearsal

    def reading(self) -> Reading:
        """See `Player`."""
        reading: Reading = self._ask(Call("reading"))
        return reading

    def report(self) -> ArmReport:
        """See `Player`."""
        report: ArmReport = self._ask(Call("report"))
        return report

    def recover(self) -> Reading:
        """See `Player`."""
        reading: Reading = self._ask(Call("recover"))
        return reading

    def carry(self, payload: Payload) -> Reading:
        """See `Player`."""
        reading: Reading = self._ask(Call("carry", (payload,)))
        return reading

    def play(self, motion: PlayableMotion, word: Callable[[], bytes]) -> PlayOutcome:
        """Play `motion`.

        `word` is called every 5 ms and returns the word for the player: ALIVE, PEDAL or REQUESTED.
        """
        longest_s = motion.path.duration_s + float(motion.stop_s.max()) + HOLD_S + self._timing.overrun_s
        with self._asking:
            self._send(Call(PLAY, (motion, since_boot_s())))
            for _ in range(round(longest_s / WORD_EVERY_S)):
                if self._child.answers(WORD_EVERY_S):
                    outcome: PlayOutcome = self._receive()
                    return outcome
                self._child.send_word(word())
        self._child.kill()
        raise Failure(
            LOST, f"the player did not answer {self._timing.overrun_s:g} s after the motion should have ended"
        )

    def close(self) -> None:
        """End the process by closing its pipes."""
        self._child.close()

    def _ask(self, request: Call, silent: str = "the arm's player does not answer", within_s: float = ANSWER_S) -> Any:
        with self._asking:
            self._send(request)
            if not self._child.answers(within_s):
                self._child.kill()
                raise Failure(LOST, f"{silent} ({within_s:g} s)")
            return self._receive()

    def _send(self, request: Call) -> None:
        try:
            self._child.send(request)
        except ChildGone as how:
            raise _gone(how) from how

    def _receive(self) -> Any:
        try:
            answer = self._child.receive()
        except ChildGone as how:
            raise _gone(how) from how
        if isinstance(answer, Failure):
            raise answer
        return answer


def _gone(how: ChildGone) -> Failure:
    return Failure(LOST, f"the process that plays motions was {how}; the arm's controller has stopped the arm")


STATES = 1000
"""States to take: one second of them."""


Inspection = tuple[Reading, Rhythm, tuple[str, ...]]
"""The arm's state, how evenly its states arrived, and the real-time properties that the computer denies the player."""


@contextmanager
def _at_rest(model: str, settings: FrankaSettings, realtime: bool) -> Iterator[PlayerProcess]:
    """A player only for questions. Raises DeviceUnavailable, also for a Failure within."""
    player: PlayerProcess | None = None
    try:
        player = PlayerProcess(model, settings, Timing(realtime=realtime))
        yield player
    except Failure as failure:
        raise DeviceUnavailable(failure.text) from failure
    finally:
        if player is not None:
            player.close()


def inspect(model: str, settings: FrankaSettings, *, realtime: bool, states: int = STATES) -> Inspection:
    """Connect, read mode and joints, and take `states` states at 1 kHz. Nothing moves, and no setting changes.

    `realtime` as far as the kernel permits it. Raises DeviceUnavailable.
    """
    with _at_rest(model, settings, realtime) as player:
        return player.reading(), player.listen(states), player.notes


def ask_report(model: str, settings: FrankaSettings, *, realtime: bool) -> ArmReport:
    """The arm's description of itself. Nothing moves, and no setting changes. Raises DeviceUnavailable."""
    with _at_rest(model, settings, realtime) as player:
        return player.report()


STARTS, REST_READINGS = 10, 60_000
"""A rehearsal: ten starts without a motion, and a minute at rest."""


def rehearse(
    model: str, settings: FrankaSettings, *, realtime: bool, starts: int = STARTS, readings: int = REST_READINGS
) -> Rehearsal:
    """The times and distances that the arm needs before a motion. The settings of a motion are sent, and nothing moves.

    Raises DeviceUnavailable.
    """
    with _at_rest(model, settings, realtime) as player:
        return player.rehearse(starts, readings)
