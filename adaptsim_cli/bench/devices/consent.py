"""The operator's consent: the questions before a real arm moves, once per command and once per motion.

The screen writes every question and answer with its time into the log of the arm and of the session.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import UTC, datetime

from adaptsim_cli.bench.devices.known_arm import STOP_BUTTON_DAYS, KnownArm, SetUp
from adaptsim_cli.bench.devices.recovery import offer_recovery
from adaptsim_cli.bench.rig_file.waivers import Waivable, WaiverPart
from adaptsim_cli.errors import StoppedByOperator
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.screen.keys import Key, enter, stop
from adaptsim_cli.screen.release import Each, before_first, require_word
from hw.ports import Arm

SLOW_PACE = 0.3
"""The first motion with a new rig file, tool or calibration is at most this fast."""
FULL_SPEED = "full"
"""The word for a first motion at full speed. No key of a question depends on a name."""
NOBODY = "stopped by the operator; nothing has moved"
_WAY_OUT = "The command ends; nothing has moved."


@dataclass
class Consent:
    """Asks the operator beside one arm during one command. Every question raises StoppedByOperator at q."""

    screen: Screen
    where: str  # the arm, for a person
    table: str = "nothing on the table but the object"
    operator: str = ""  # "": asked
    pedal: bool = False
    pace: float = 1.0
    waivers: tuple[WaiverPart, ...] = ()  # those of the rig file that count
    each: Each = "command"
    known_arm: KnownArm | None = None  # None: an arm that nothing is remembered of
    setup: SetUp = field(default_factory=SetUp)  # `known_arm.setup_of`
    rig_file: str = ""  # a sentence: the file, its boxes and its waivers
    given_at: str | None = field(default=None, init=False)  # ISO 8601: when the arm's model was typed
    _slow_ended: bool = field(default=False, init=False)

    def once(self, arm: Arm) -> None:
        """Before the first motion of a command: name, stop button, slow start, and the typed model."""
        if self.given_at is not None:
            return
        if (unended := self.known_arm.unended() if self.known_arm else None) is not None:
            self.screen.note(unended)
        self._name()
        self.stop_button(arm)
        self._slow_start()
        if self.pace < 1.0:
            self.screen.note(f"Every motion is played at pace {self.pace:g}; nothing is learnt from these trials")
        self.screen.note(before_first(f"THE REAL ROBOT, {self.where},", self.table, self.pedal))
        if self.rig_file:
            self.screen.note(self.rig_file)
        agreed = Key(arm.model, "to confirm", "The arm may move; the program still asks before it does.")
        require_word(self.screen, "Have you checked all of this?", agreed)
        self.given_at = datetime.now(UTC).isoformat(timespec="seconds")

    def completed(self) -> None:
        """Note that the task's own motion, or a whole series, was completed. After a slow one, its set-up counts as
        known.
        """
        if self.known_arm is not None and self.pace <= SLOW_PACE and not self._slow_ended:
            self.known_arm.moved_slowly(self.setup)
            self._slow_ended = True

    def _waives(self, what: Waivable) -> bool:
        return any(waiver.safeguard == what for waiver in self.waivers)

    def _name(self) -> None:
        self.operator = self.operator or self.screen.name("Who operates the arm?", NOBODY)
        self.screen.tell_listeners(f"operator: {self.operator}")

    def stop_button(self, arm: Arm) -> None:
        """If a check is due, have the stop button pressed, wait until the arm reports it, have it released, and
        recover.
        """
        if self.known_arm is None or self._waives("stop_button"):
            return
        if not self.known_arm.read().stop_button_is_due(datetime.now(UTC)):
            return
        self.screen.note(
            f"The arm's stop button was not checked in the last {24 * STOP_BUTTON_DAYS} hours. It is the safety device "
            "of this lab."
        )
        for question, pressed in (
            ("Press the arm's stop button now (nothing moves).", True),
            ("Release it, and activate FCI in Desk if it asks for it (nothing moves).", False),
        ):
            while True:
                then = "Reads the arm's state. Nothing moves."
                self.screen.go_on(question, "when done", then=then, assurance="nothing has moved")
                state = arm.state()
                if state.by_hand == pressed and (pressed or state.fault is None):
                    break
                if not pressed and not state.by_hand:
                    offer_recovery(arm, self.screen)
                    if arm.state().fault is None:
                        break
                    raise StoppedByOperator(NOBODY)
                self.screen.note(f"  The arm reports: {state.fault or 'ready to move'}")
        self.known_arm.stop_button_checked(self.operator)
        self.screen.note("  The stop button stops this arm.")

    def _slow_start(self) -> None:
        """A set-up that has never moved this arm begins slowly, unless a named person takes the responsibility."""
        if self.known_arm is None or self._waives("slow_start") or self.pace <= SLOW_PACE:
            return
        facts = self.known_arm.read()
        if facts.slow_motion(self.setup):
            return
        self.screen.note(
            f"{facts.new_in(self.setup)} not moved the arm yet, so its own first motion should be slow: end this "
            f"command and add --pace {SLOW_PACE:g}."
        )
        full = Key(FULL_SPEED, "to move at full speed on your own account", "Your name is stored with this decision.")
        leave = enter("to end the command", _WAY_OUT)
        if self.screen.choose("Full speed nevertheless?", full, leave, stop(_WAY_OUT)) != FULL_SPEED:
            raise StoppedByOperator(f"{NOBODY}. Run it slowly first: add --pace {SLOW_PACE:g}")
        self.screen.tell_listeners(f"full speed with a set-up that never moved slowly, on account of {self.operator}")
