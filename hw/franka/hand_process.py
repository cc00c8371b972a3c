"""The Franka Hand behind `hw.ports.Hand`, in processes of its own, so that the program never waits for the SDK."""

from __future__ import annotations

import time
from typing import Any, Self

from hw.child import Call, Child, ChildGone
from hw.errors import DeviceUnavailable, HandError
from hw.franka.hand import OPEN, STATE
from hw.franka.hand_keeper import OPEN_S, READ_S, SECOND_S, STOP_S, WORKER_S
from hw.franka.hand_stop import STILL_S, WATCH_S, Stopped
from hw.ports import Pedal
from hw.types import HandState
from hw.watchdog import ALIVE, PEDAL, REQUESTED, SILENCE_S, WORD_EVERY_S

LONGEST_S = 30.0
"""The longest time for a command: the fingers need three seconds for their whole travel."""
_STOPPED_S = STOP_S + WORKER_S + WATCH_S + 2.0 * STILL_S + READ_S
"""How long the hand's process may take to stop the fingers, and to check that they stand still."""


class HandProcess:
    """Entering connects. With a pedal the fingers move only while it is held.

    The hand is sent a stop (`Gripper.stop`) within 80 ms if the pedal is released, on Ctrl-C, and if the program hangs
    or is killed. Then its width is read: a hand may accept a stop and go on (`hw.errors.FingersMoved`). After a stop it
    is disconnected: enter it again, and home it.
    """

    def __init__(self, model: str, host: str, *, pedal: Pedal | None = None, silence_s: float = SILENCE_S) -> None:
        """`model` is the arm's model, a key of `hw.franka.versions.PACKAGES`, and `host` is its address."""
        self._model, self._host, self._pedal, self._silence_s = model, host, pedal, silence_s
        self._child: Child | None = None
        self.stopped_after_s: float | None = None
        """Time in s from the request to stop to the hand's answer, of the last stopped command."""

    def __enter__(self) -> Self:
        """Raises DeviceUnavailable."""
        self._child = Child("hw.franka.hand_keeper", str(self._silence_s))
        try:
            self._ask(Call(OPEN, (self._model, self._host)), OPEN_S + SECOND_S + READ_S)
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *exc: object) -> None:
        if self._child is not None:
            self._child.close()
            self._child = None

    def state(self) -> HandState:
        """See `hw.ports.Hand`."""
        return self._ask(Call(STATE), 2.0 * READ_S)

    def home(self) -> None:
        """See `hw.ports.Hand`."""
        self._do(Call("home"))

    def move(self, width_m: float) -> None:
        """See `hw.ports.Hand`."""
        self._do(Call("move", (width_m,)))

    def grasp(self, width_m: float, force_N: float) -> None:
        """See `hw.ports.Hand`."""
        self._do(Call("grasp", (width_m, force_N)))

    def _ask(self, call: Call, within_s: float) -> HandState:
        """Raises HandError, DeviceUnavailable."""
        child = self._connected()
        try:
            child.send(call)
            if not child.answers(within_s):
                self.__exit__()
                raise DeviceUnavailable(f"the hand at {self._host} does not answer within {within_s:g} s")
            return self._told(child.receive())
        except ChildGone as how:
            raise self._gone(how) from how

    def _do(self, command: Call) -> None:
        """Raises HandError, also if it was stopped, and DeviceUnavailable."""
        child = self._connected()
        if self._pedal is not None and not self._pedal.enabled():
            raise HandError(f"{self._pedal.why_not()}; the hand has not moved, hold the pedal and try again")
        try:
            child.send(command)
            until_s = time.monotonic() + LONGEST_S
            while not child.answers(WORD_EVERY_S):
                late = time.monotonic() > until_s
                child.send_word(REQUESTED if late else self._word())
                if late and not child.answers(_STOPPED_S):
                    raise self._lost(
                        f"the hand did not finish its command within {LONGEST_S:g} s and did not answer a stop"
                    )
            self._told(child.receive())
        except ChildGone as how:
            raise self._gone(how) from how
        except BaseException as error:  # Ctrl-C: the hand's process is informed and stops the hand
            if not isinstance(error, HandError | DeviceUnavailable):
                error.add_note(self._interrupted(child))
            raise

    def _word(self) -> bytes:
        return PEDAL if self._pedal is not None and not self._pedal.enabled() else ALIVE

    def _interrupted(self, child: Child) -> str:
        """Stop the fingers, and return a sentence for a person about how they stopped."""
        try:
            child.send_word(REQUESTED)
            answer = child.receive() if child.answers(_STOPPED_S) else None
        except ChildGone:
            answer = None
        finally:
            self.__exit__()
        if isinstance(answer, HandState):
            return "the hand had ended its command"
        if isinstance(answer, Stopped | HandError):
            return str(answer.error() if isinstance(answer, Stopped) else answer)
        return f"it is not known whether the hand's fingers stand still ({answer or 'no answer'}): look at the hand"

    def _told(self, answer: Any) -> HandState:
        if isinstance(answer, HandState):
            return answer
        if isinstance(answer, Stopped):
            self.stopped_after_s = answer.after_s
            self.__exit__()
            raise answer.error()
        if isinstance(answer, HandError):
            raise answer
        raise self._lost(str(answer))

    def _lost(self, text: str) -> DeviceUnavailable:
        self.__exit__()
        return DeviceUnavailable(text)

    def _gone(self, how: ChildGone) -> DeviceUnavailable:
        return self._lost(f"the process that watches the hand was {how}; look at the hand, then run the command again")

    def _connected(self) -> Child:
        if self._child is None:
            raise DeviceUnavailable("the hand is not connected: use it inside a `with` block")
        return self._child
