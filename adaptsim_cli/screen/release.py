"""The questions that let an arm or a hand move: `y` for one motion, the arm's model, typed, for several.

Enter lets nothing move. A foot at the pedal cannot answer: it only enables what a hand has released.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from math import inf
from typing import Literal

from adaptsim_cli.errors import StoppedByOperator
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.screen.keys import Key, stop
from adaptsim_cli.screen.views import clear_to_move

Each = Literal["motion", "command"]
"""The motions that one answer releases: one motion, or all motions that a question announces."""
NOTHING_MOVED = "nothing has moved"
ONE = "One motion begins. Ctrl-C stops it along its path; Enter lets nothing move."


def require_word(screen: Screen, question: str, word: Key, assurance: str = NOTHING_MOVED) -> None:
    """Ask until `word` is typed; Enter does nothing. Raises StoppedByOperator at q."""
    if screen.choose(question, word, stop(f"The command ends; {assurance}.")) == "q":
        raise StoppedByOperator(f"stopped by the operator; {assurance}")


def before_first(robot: str, table: str, pedal: bool) -> str:
    """The announcement before the first motion of a command; `table` names the things that may lie there."""
    from hw.stopping import WORST_STOP_S

    return (
        f"{robot} is about to move for the first time. Check: nobody within its reach, {table}, a hand on the arm's "
        f"stop button{', a foot at the pedal' if pedal else ''}. Once told to stop, it moves on for up to "
        f"{WORST_STOP_S:.2f} s; `adaptsim doctor` says how far."
    )


@dataclass(eq=False)
class Release:
    """Which motions of one arm and its hand may begin, during one command. Every question may raise StoppedByOperator.

    `motion` is asked before each of them, by the arm itself: what no question has released is asked for there.
    """

    screen: Screen | None = None  # None: nobody is asked, in the simulated lab only
    model: str = ""  # of the arm; it is typed to release several motions
    real: bool = False
    each: Each = "motion"
    first: Callable[[], None] = lambda: None  # what is asked once, before anything else
    completed: Callable[[], None] = lambda: None
    """Call it when the task's own motion, or a whole series, came to its end: the way there or home does not count."""
    _left: float = field(default=0, init=False)  # motions that may begin without another question
    _run: tuple[str, str] | None = field(default=None, init=False)
    _watched: bool = field(default=False, init=False)  # a motion of the run was watched
    _started: bool = field(default=False, init=False)

    @property
    def asks_each(self) -> bool:
        """Whether each motion is asked for."""
        return self.screen is not None and self.each == "motion"

    def start(self) -> None:
        """Ask what is asked once."""
        if not self._started:
            self.first()
            self._started = True

    def one(self, question: str, then: str = ONE, assurance: str = NOTHING_MOVED) -> None:
        """Ask for `y`; the next motion may begin."""
        if self.screen is not None:
            self.start()
            require_word(self.screen, question, Key("y", "to start", then), assurance)
            self._left = 1

    def sequence(self, question: str, then: str, assurance: str = NOTHING_MOVED) -> None:
        """Ask for the arm's model; motions may begin until the announced run is over."""
        if self.screen is not None:
            self.start()
            require_word(self.screen, question, Key(self.model, "to let it move", then), assurance)
            self._left = inf if self._run else 0

    def announced(self, question: str, then: str, assurance: str) -> None:
        """A question about a trial: it releases the first motion, or where the rig file says so all of them."""
        if self.each == "motion" or not self.model:
            self.one(question, then, assurance)
        else:
            self.sequence(question, then, assurance)

    def motion(self, what: str = "makes its next motion", duration_s: float | None = None) -> None:
        """Returns once the next motion, which does `what`, may begin."""
        if self.screen is None or self._left:
            return
        if self._run is not None and (self._watched or self.each == "command"):
            what = self._run[1]
            then = f"It {what}. Ctrl-C stops it along its path; Enter lets nothing move."
            self.sequence(clear_to_move(self.real, what) + ".", then, "everything completed is stored")
        elif self._run is not None:
            self.one(clear_to_move(self.real, self._run[0], duration_s) + ".")
        elif self.each == "motion":
            self.one(clear_to_move(self.real, what, duration_s) + ".", assurance="this motion has not begun")
        else:
            self.start()

    def begun(self) -> None:
        """The released motion begins."""
        self._left = max(0, self._left - 1)
        self._watched = self._run is not None

    def begin_run(self, first: str, rest: str) -> None:
        """A series begins: its first motion, which does `first`, is released alone and watched; then the `rest`."""
        self._run, self._watched, self._left = (first, rest), False, 0

    def end_run(self) -> None:
        """The series is over."""
        self._run, self._left = None, 0
