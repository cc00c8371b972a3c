"""The answers of a setup. Each question has a default; a wrong answer is explained, and the question is asked again.

A setup begins with the rig file that is there, or a first one (`begun`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, TypeVar, cast

from adaptsim_cli.bench.devices.known_arm import KnownArm, folder_of
from adaptsim_cli.bench.rig_file.description import ArmPart, Model, RigDescription, as_shipped
from adaptsim_cli.bench.rig_file.reading import OWN_ROBOT, described, tasks_with_tools, without_old_waivers
from adaptsim_cli.bench.rig_file.template import template
from adaptsim_cli.bench.rig_file.waivers import DAYS, SHORTEST_REASON, WITHOUT, Waivable
from adaptsim_cli.config import PRACTICE_FILE, Config, Places, Resolved
from adaptsim_cli.errors import StoppedByOperator, UsageError
from adaptsim_cli.screen import console
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.storage import durable

NOTHING = "none"
WAIVE = "waive"
"""The answer that leads to the question for a reason to go without."""
T = TypeVar("T")


@dataclass
class Answers:
    """The rig file as answered so far, and how to ask for more of it."""

    config: Config
    places: Places
    file: Path
    rig: RigDescription
    screen: Screen
    defaults: bool  # every default is taken, nobody is asked

    @property
    def resolved(self) -> Resolved:
        """The settings of a command that runs with this rig file."""
        return Resolved(self.config, {}, self.places)

    @property
    def prompt_screen(self) -> Screen | None:
        """The screen on which the operator answers before a motion; None in the simulated lab, where nobody answers."""
        return None if self.defaults else self.screen

    @property
    def known_arm(self) -> KnownArm:
        """The memory of this computer of the arm."""
        return KnownArm(folder_of(self.places, self.rig))

    def text(self, question: str, default: str, explain: str) -> str:
        """An answer as typed; Enter gives the default, if there is one, and `?` shows `explain`.

        Raises StoppedByOperator.
        """
        if self.defaults:
            return default
        leave = f" Enter takes {default}; q leaves." if default else " q leaves."
        answer = self.screen.words(f"{question} [{default}]:" if default else f"{question[:-1]}:", explain + leave)
        if answer is None:
            raise StoppedByOperator("stopped by the operator; every completed step is kept")
        return answer or default

    def ask(self, question: str, default: str, read: Callable[[str], T], explain: str) -> T:
        """Ask until `read` takes the answer; it raises UsageError for a wrong one."""
        while True:
            try:
                return read(self.text(question, default, explain))
            except UsageError as error:
                if self.defaults:
                    raise
                self.screen.note(f"  {error}")

    def take(self, question: str, default: str, parts: Callable[[str], Mapping[str, Any]], explain: str) -> None:
        """Ask until `parts` of the answer fit into the rig file."""
        self.ask(question, default, lambda text: self.put(**parts(text)), explain)

    def put(self, **parts: Any) -> None:
        """Replace parts of the rig file. Raises UsageError, and nothing is replaced, if the whole is not valid."""
        try:
            self.rig = described(asdict(self.rig) | parts, "")
        except UsageError as error:
            raise UsageError(str(error).removeprefix(": ")) from error

    def one_of(self, question: str, choices: Sequence[str], default: str, explain: str) -> str:
        """Ask until the answer is one of `choices`."""
        while (answer := self.text(f"{question} {', '.join(choices)}.", default, explain).lower()) not in choices:
            self.screen.note(f"  {answer!r}: choose one of {', '.join(choices)}")
        return answer

    def waive(self, what: Waivable, **without: Any) -> bool:
        """Ask a person why the lab goes without a safeguard, and put the waiver and `without` into the rig file.

        Enter waives nothing. Returns whether it is waived. Raises StoppedByOperator.
        """
        self.screen.plain(f"  Without it {WITHOUT[what]}.")
        self.screen.plain(f"  Reason, name and day are recorded everywhere; it ends in {DAYS} days.")
        reason = self._typed("Why does this lab go without it? One sentence; Enter waives nothing:")
        if len(reason) < SHORTEST_REASON:
            self.screen.note(f"  Nothing is waived: a reason has at least {SHORTEST_REASON} letters.")
            return False
        by = self.config.operator or self._typed("Who decides this? Your name; Enter waives nothing:")
        if not by:
            self.screen.note("  Nothing is waived, because a waiver needs a name.")
            return False
        waiver = {"safeguard": what, "reason": reason, "by": by, "on": datetime.now(UTC).date().isoformat()}
        self.put(waivers=[*self.waivers_but(what), waiver], **without)
        self.screen.note(f"  Waived: {self.rig.waivers[-1].sentence}")
        return True

    def waivers_but(self, what: Waivable) -> list[dict[str, Any]]:
        """All waivers except that of the safeguard `what`, which the lab now has."""
        return [asdict(waiver) for waiver in self.rig.waivers if waiver.safeguard != what]

    def _typed(self, question: str) -> str:
        answer = self.screen.words(question)
        if answer is None:
            raise StoppedByOperator("stopped by the operator; every completed step is kept")
        return answer.strip()

    def save(self) -> None:
        """Write the rig file, whole, with a comment at every key. Raises SessionError."""
        durable.make_folder(self.file.parent)
        durable.replace_file(self.file, template(self.rig, tasks_with_tools()).encode())


def numbers(text: str, count: int) -> list[float]:
    """The `count` numbers of a text, with blanks or commas between them. Raises UsageError."""
    try:
        values = [float(word) for word in text.replace(",", " ").split()]
    except ValueError:
        values = []
    if len(values) != count:
        raise UsageError(f"{text!r}: {count} number{'s' if count > 1 else ''} belong{'' if count > 1 else 's'} here")
    return values


def as_typed(values: Sequence[float]) -> str:
    """Numbers as `numbers` reads them."""
    return " ".join(f"{value:g}" for value in values)


ADDRESS = "172.16.0.2"
"""Default address of an arm's control box."""


def begun(resolved: Resolved, screen: Screen, *, yes: bool) -> Answers:
    """The answers so far. Raises UsageError: a rig file of another arm, no terminal, `yes` for a real arm."""
    config, places = resolved.config, resolved.places
    if config.is_own:
        raise UsageError(OWN_ROBOT)
    if yes and not config.is_simulated:
        raise UsageError("a real lab is set up by a person at a terminal: leave out --yes")
    if not yes:
        console.require_terminal("there is no terminal to ask at: run in a terminal; in the simulated lab add --yes")
    project, user = places.rig_files
    if config.is_simulated:
        here = project if places.project_file.is_file() else user
        file, new = here.with_name(PRACTICE_FILE), as_shipped("panda")
        rig = _continued(file, screen) if file.is_file() else RigDescription("practice", new.arm)
    else:
        if config.rig and not config.rig_is_own:
            raise UsageError(
                f"{config.rig} belongs to the current folder, and a setup writes your own rig file, {user}. Run it "
                f"from another folder. To take this file over, read it first: cp {config.rig} {user}"
            )
        file = Path(config.rig) if config.rig else user
        arm = ArmPart(cast(Model, config.hw), ADDRESS)
        rig = _continued(file, screen) if file.is_file() else RigDescription("lab", arm)
        if rig.arm.model != config.hw:
            raise UsageError(f"{file} is the rig file of a {rig.arm.model}: say --hw {rig.arm.model}, or move it away")
    operator = config.operator
    if not (operator or config.is_simulated):
        operator = screen.name("Who sets it up?", "stopped by the operator; nothing has been written")
    config = config.model_copy(update={"rig": str(file), "operator": operator})
    return Answers(config, places, file, rig, screen, yes)


def _continued(file: Path, screen: Screen) -> RigDescription:
    """The rig file that a setup continues. Waivers of an older version are dropped, and asked for again."""
    content, dropped = without_old_waivers(file)
    if dropped:
        screen.note(
            f"{file} waives {', '.join(dropped)} in the way of an older version, which no longer counts. Each of these "
            "safeguards is required, or you are asked for a reason to go without it"
        )
    return described(content, str(file), tasks_with_tools())
