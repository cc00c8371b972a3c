"""The questions that let an arm or a hand move: `y` for one motion, the arm's model, typed, for several.

Enter alone moves nothing. A foot at the pedal cannot answer: it only enables a motion that a person has released at the
keyboard. A `y` releases one motion, which is identified by its digest. It is used up once that motion is tried, and it
releases no other.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

from adaptsim_cli.errors import StoppedByOperator
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.screen.keys import Key, stop
from adaptsim_cli.screen.views import clear_to_move

if TYPE_CHECKING:
    from hw.types import JointPath

Each = Literal["motion", "command"]
"""The motions that one answer releases: one motion, or all motions that a question announces."""
NOTHING_MOVED = "nothing has moved"
ONE = "One motion begins. Ctrl-C stops it along its path; Enter alone moves nothing."


def require_word(screen: Screen, question: str, word: Key, assurance: str = NOTHING_MOVED) -> None:
    """Ask until `word` is typed; Enter does nothing. Raises StoppedByOperator at q."""
    if screen.choose(question, word, stop(f"The command ends; {assurance}.")) == "q":
        raise StoppedByOperator(f"stopped by the operator; {assurance}")


def digest_of(*what: str | float) -> str:
    """The digest of a motion that has no path: of the fingers, or of a robot of one's own."""
    return hashlib.sha256(repr(what).encode()).hexdigest()


def grasping(width_m: float, force_N: float) -> str:
    """The digest of a grasp, for the question that comes before it."""
    return digest_of("grasp", width_m, force_N)


def before_first(robot: str, table: str, pedal: bool) -> str:
    """The announcement before the first motion of a command; `table` names the things that may lie there."""
    from hw.braking import WORST_STOP_S

    return (
        f"{robot} is about to move for the first time. Check: nobody within its reach, {table}, a hand on the arm's "
        f"stop button{', a foot at the pedal' if pedal else ''}. Once told to stop, it moves on for up to "
        f"{WORST_STOP_S:.2f} s: {100.0 * WORST_STOP_S:.0f} cm if it moves at 1 m/s."
    )


@dataclass(eq=False)
class Release:
    """Which motions of one arm and its hand may begin, during one command. Every question may raise StoppedByOperator.

    Arm and hand call `take` before each of their motions, with its digest; a motion that no question has released is
    asked for there.
    """

    screen: Screen | None = None  # None: nobody is asked, in the simulated lab only
    model: str = ""  # of the arm; it is typed to release several motions
    real: bool = False
    each: Each = "motion"
    first: Callable[[], None] = lambda: None  # what is asked once, before anything else
    completed: Callable[[], None] = lambda: None
    """Call it after the task's own motion, or a whole series, was played to its end; the approach and the way home do
    not count."""
    _released: str = field(default="", init=False)  # digest of the one motion that a `y` lets begin; "": none
    _run: tuple[str, str] | None = field(default=None, init=False)
    _run_released: bool = field(default=False, init=False)  # the arm's model was typed for the rest of the run
    _watched: bool = field(default=False, init=False)  # a motion of the run was watched
    _started: bool = field(default=False, init=False)

    @property
    def asks_each(self) -> bool:
        """Whether each motion is asked for."""
        return self.screen is not None and self.each == "motion"

    def start(self) -> None:
        """Ask the questions that are asked once per command."""
        if not self._started:
            self.first()
            self._started = True

    def one(self, question: str, digest: str, then: str = ONE, assurance: str = NOTHING_MOVED) -> None:
        """Ask for `y`; the motion of this digest, and no other, may begin."""
        self.withdraw()
        if self.screen is not None:
            self.start()
            require_word(self.screen, question, Key("y", "to start", then), assurance)
            self._released = digest

    def sequence(self, question: str, then: str, assurance: str = NOTHING_MOVED) -> None:
        """Ask for the arm's model; motions may begin until the announced run is over."""
        self.withdraw()
        if self.screen is not None:
            self.start()
            require_word(self.screen, question, Key(self.model, "to let it move", then), assurance)
            self._run_released = self._run is not None

    def announced(self, question: str, digest: str, then: str, assurance: str) -> None:
        """A question about a trial: it releases the first motion, or all of them if the rig file says so."""
        if self.each == "motion" or not self.model:
            self.one(question, digest, then, assurance)
        else:
            self.sequence(question, then, assurance)

    def motion(self, digest: str, what: str = "makes its next motion", duration_s: float | None = None) -> None:
        """Returns once the motion of this digest, which does `what`, may begin."""
        if self.screen is None or self._run_released or (digest and digest == self._released):
            return
        if self._run is not None and (self._watched or self.each == "command"):
            what = self._run[1]
            then = f"It {what}. Ctrl-C stops it along its path; Enter alone moves nothing."
            self.sequence(clear_to_move(self.real, what) + ".", then, "everything completed is stored")
        elif self._run is not None:
            self.one(clear_to_move(self.real, self._run[0], duration_s) + ".", digest)
        elif self.each == "motion":
            self.one(clear_to_move(self.real, what, duration_s) + ".", digest, assurance="this motion has not begun")
        else:
            self.start()

    def path(self, what: str, path: JointPath) -> None:
        """Returns once the arm may play `path`, which does `what`."""
        self.motion(path.digest, what, path.duration_s)

    def take(self, digest: str, what: str = "makes its next motion", duration_s: float | None = None) -> None:
        """Returns once this motion may be tried. However it ends, another motion needs an answer of its own."""
        try:
            self.motion(digest, what, duration_s)
        finally:
            self.withdraw()

    def withdraw(self) -> None:
        """Withdraw every `y`, so that none releases a motion any more."""
        self._released = ""

    def begun(self) -> None:
        """The motion that was taken begins; if it is the first one of a run, a person watches it from now on."""
        self._watched = self._run is not None

    @contextmanager
    def run(self, first: str, rest: str) -> Iterator[None]:
        """A context manager around a series. Its first motion (`first` describes it) is released alone and watched,
        then the `rest`.

        However the series ends, nothing stays released.
        """
        self.withdraw()
        self._run, self._watched, self._run_released = (first, rest), False, False
        try:
            yield
        finally:
            self.withdraw()
            self._run, self._run_released = None, False
