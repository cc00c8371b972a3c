"""The walk through a setup. Read `STEPS` from the top: this is the order of a lab's first day.

A step is done once nothing in its part of the doctor's checklist is missing. Completed steps are stored on the disk. A
walk that was stopped or killed continues at the first step that is not completed, or whose check no longer passes. If a
step is repeated, all later ones have to be repeated too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from rich.text import Text

from adaptsim_cli.bench.doctor import checks, table
from adaptsim_cli.bench.doctor.table import Severity
from adaptsim_cli.bench.rig_file.devices import DEVICES
from adaptsim_cli.bench.rig_file.reading import gaps
from adaptsim_cli.bench.rig_file.waivers import WITHOUT, Waivable
from adaptsim_cli.commands.setup_steps import describing, moving
from adaptsim_cli.commands.setup_steps.answers import Answers
from adaptsim_cli.errors import PreflightFailed, SessionError, StoppedByOperator, UsageError
from adaptsim_cli.screen import views
from adaptsim_cli.screen.continuing import how_to_continue
from adaptsim_cli.screen.keys import Key, enter, stop
from calib.errors import CalibrationError
from sim.errors import SimError


@dataclass(frozen=True)
class Step:
    """One step: what it asks or does, and the doctor's checks that end it."""

    name: str
    does: Callable[[Answers], None]
    checks: tuple[str, ...] = ()
    practised: str = ""  # what a real lab does here, if the simulated one has nothing to do
    touches: bool = False  # only for a task whose tool finds the table by touch
    safeguards: tuple[Waivable, ...] = ()  # those that it asks for; the step is done once each is there, or waived


COMPUTER = (
    "python", "packages", "libraries", "driver", "disk space", "disk speed", "real-time kernel", "priorities",
    "clock frequency", "checkpoint",
)  # fmt: skip
STEPS = (
    Step("computer", lambda _: None, COMPUTER),
    Step(
        "arm", describing.arm, ("rig file", "network", "arm", "arm model"),
        "asks for the arm's address; shows version, mode and limits of the arm, and how fast it answers",
    ),
    Step(
        "stop button", describing.stop_button, ("rig file", "stop button"),
        "asks you to press the arm's stop button, checks that the arm reports it, and asks you to release it",
    ),
    Step(
        "pedal", describing.pedal, ("rig file", *DEVICES, "instruments"),
        "asks for the serial ports of pedal, balance and instruments, and reads each", safeguards=("pedal",),
    ),
    Step(
        "camera", describing.camera, ("rig file", "camera", "camera images"),
        "lists the cameras, and films half a second with yours",
    ),
    Step("table and boxes", describing.table, ("rig file",), safeguards=("person", "keep_out")),
    Step("tool", describing.tool, ("rig file", "safeguards", "motion")),
    Step("board", moving.board, ("rig file",)),
    Step("calibration", moving.calibrate, ("rig file", "calibration")),
    Step("touch-off", moving.touch, ("rig file", "motion"), touches=True),
    Step("stop", moving.stop),
    Step("slow motion", moving.slow_motion),
    Step("first trial", moving.trial),
)  # fmt: skip


def walk(answers: Answers, *, begin: str = "") -> None:
    """Do all steps from the first one that is not done, and show the command of the first session. `begin` names a step
    to do again.

    Raises the error that stops it, with the command to continue. Every completed step is kept.
    """
    config, screen = answers.config, answers.screen
    steps = [step for step in STEPS if not step.touches or _touches(answers)]
    names = [step.name for step in steps]
    if begin and begin not in names:
        raise UsageError(f"--from {begin}: choose one of {', '.join(names)}")
    screen.show(views.badge(config.hw, "simulated lab" if config.is_simulated else config.hw))
    screen.plain(f"{len(steps)} steps. Enter takes the answer in brackets; q stops, and this command goes on.")
    with how_to_continue(f"Go on with: {command(answers)}", also=(CalibrationError, SimError, SessionError)):
        for number, step in enumerate(steps, start=1):
            screen.show(Text(f"\n{number} of {len(steps)}  {step.name}", style="bold"))
            later = begin and names.index(begin) < number
            if later or not _still_done(answers, step):
                _do(answers, step)
                answers.known_arm.set_up(names[:number])
    screen.plain(f"\nThe lab is set up. Rig file: {answers.file}")


def waive(answers: Answers, name: str) -> None:
    """Ask why this lab goes without one safeguard, and write that into the rig file. Raises UsageError."""
    what = next((one for one in WITHOUT if one == name), None)
    if what is None:
        raise UsageError(f"--waive {name}: choose one of {', '.join(WITHOUT)}")
    if answers.defaults:
        raise UsageError("a waiver has a reason that a person types: leave out --yes")
    if answers.waive(what):
        answers.save()


def command(answers: Answers) -> str:
    """The command that continues this walk."""
    return f"adaptsim setup {answers.config.same_lab}"


def _touches(answers: Answers) -> bool:
    from sim.tasks import get_task

    return get_task(answers.config.task).require_hardware().touchable is not None


def _still_done(answers: Answers, step: Step) -> bool:
    """Whether the step was done earlier, and its checks still pass."""
    return step.name in answers.known_arm.read().steps and not _missing(answers, step)


def _do(answers: Answers, step: Step) -> None:
    """Do the step until nothing is missing. Raises StoppedByOperator."""
    screen, asks = answers.screen, True
    while True:
        if asks and not _only_told(answers, step):
            step.does(answers)
            answers.save()
        if not (missing := _missing(answers, step)):
            return
        if answers.defaults:
            raise PreflightFailed(f"not ready: {', '.join(missing)}")
        again = enter("to check again", "The check runs again, once you have corrected what it names.")
        other = Key("a", "to answer again", "The questions of this step are asked again.")
        answer = screen.choose("Not ready yet.", again, other, stop("The command ends; the same command goes on."))
        if answer == "q":
            raise StoppedByOperator("stopped by the operator; every completed step is kept")
        asks = answer == "a"


def _missing(answers: Answers, step: Step) -> list[str]:
    """Make and show the checks of the step, and return the names of those that failed."""
    if _only_told(answers, step):
        answers.screen.show(f"  Simulated. A real lab {step.practised}.")
        return []
    with answers.screen.busy("Checking"):
        findings = tuple(checks.examine(answers.resolved, step.checks))
        lacking = [gap for gap in gaps(answers.rig, answers.config.task) if gap.what in step.safeguards]
    rows = [finding for finding in findings if finding.verdict is not Severity.SKIPPED]
    answers.screen.print(table.checks_table(rows, grouped=False))
    for gap in lacking:
        answers.screen.note(f"  {gap.what}: {gap.message}")
    return [*table.missing_in(findings), *(gap.what for gap in lacking)]


def _only_told(answers: Answers, step: Step) -> bool:
    return bool(step.practised) and answers.config.is_simulated
