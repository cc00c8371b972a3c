"""The walk through a setup. Read `STEPS` from the top: this is the order of a lab's first day.

A step is done once nothing in its part of the doctor's checklist is missing. What is done is remembered on the disk; a
walk that was stopped or killed goes on at the first step that is not done, or whose check no longer passes. A step that
is done again makes all later ones due.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from rich.text import Text

from adaptsim_cli.devices.rig_file.reading import BOARD
from adaptsim_cli.doctor import checks, examination
from adaptsim_cli.doctor.checks import Finding
from adaptsim_cli.errors import SessionError, StoppedByOperator, UsageError
from adaptsim_cli.screen import views
from adaptsim_cli.screen.continuing import how_to_continue
from adaptsim_cli.screen.keys import Key, enter, stop
from adaptsim_cli.setup import describing, moving
from adaptsim_cli.setup.answers import Answers
from calib.errors import CalibrationError
from sim.errors import SimError


@dataclass(frozen=True)
class Step:
    """One step: what it asks or does, and the checks that end it."""

    name: str
    does: Callable[[Answers], None]
    checks: Callable[[Answers], Iterable[Finding]]
    practised: str = ""  # what a real lab does here, if the simulated one has nothing to do
    touches: bool = False  # only for a task whose tool finds the table by touch


def _computer(answers: Answers) -> Iterable[Finding]:
    arm = None if answers.config.is_simulated else answers.config.hw
    return (*examination.program(arm), *examination.machine(answers.config, answers.places, arm))


def _stated(answers: Answers, tool: str, *names: str) -> Iterable[Finding]:
    """The gaps of these names in the rig file."""
    return (finding for finding in checks.required(answers.rig, tool) if finding.name in names)


def _nothing(answers: Answers) -> None:
    """Nothing is asked."""


STEPS = (
    Step("computer", _nothing, _computer),
    Step(
        "arm", describing.arm, lambda a: examination.arm(a.rig),
        "asks for the arm's address; shows version, mode and limits of the arm, and how fast it answers",
    ),
    Step(
        "stop button", describing.stop_button, lambda a: (examination.stop_button(a.places, a.rig),),
        "has you press the arm's stop button, sees that the arm says so, and has you release it",
    ),
    Step(
        "pedal", describing.pedal,
        lambda a: (*_stated(a, a.config.task, "pedal"), *examination.pedal(a.rig), *examination.balance(a.rig)),
        "asks for the serial ports of pedal and balance, and reads both",
    ),
    Step(
        "camera", describing.camera, lambda a: examination.camera(a.rig),
        "lists the cameras, and films half a second with yours",
    ),
    Step("table and boxes", describing.table, lambda a: _stated(a, a.config.task, "person", "keep_out")),
    Step(
        "tool", describing.tool,
        lambda a: (*_stated(a, a.config.task, "payload"), examination.motion(a.resolved)),
    ),
    Step("board", moving.board, lambda a: _stated(a, BOARD, "payload")),
    Step("calibration", moving.calibrate, lambda a: (examination.calibration(a.config, a.places),)),
    Step("touch-off", moving.touch, lambda a: (examination.motion(a.resolved),), touches=True),
    Step("slow motion", moving.slow_motion, lambda _: ()),
    Step("first trial", moving.trial, lambda _: ()),
)  # fmt: skip


def walk(answers: Answers, *, begin: str = "") -> None:
    """From the first step that is not done to the command of the first session; `begin` names a step to do again.

    Raises the error that stops it, with the command to continue. Every completed step is kept.
    """
    config, screen = answers.config, answers.screen
    steps = [step for step in STEPS if not step.touches or _touches(answers)]
    names = [step.name for step in steps]
    if begin and begin not in names:
        raise UsageError(f"--from {begin}: choose one of {', '.join(names)}")
    screen.show(views.badge(config.hw, "simulated lab" if config.is_simulated else config.hw))
    screen.plain(f"{len(steps)} steps. Enter takes what stands in brackets, q stops; the same command goes on.")
    with how_to_continue(f"Go on with: {command(answers)}", also=(CalibrationError, SimError, SessionError)):
        for number, step in enumerate(steps, start=1):
            screen.show(Text(f"\n{number} of {len(steps)}  {step.name}", style="bold"))
            later = begin and names.index(begin) < number
            if later or not _still_done(answers, step):
                _do(answers, step)
                answers.known.set_up(names[:number])
    screen.plain(f"\nThe lab is set up. Rig file: {answers.file}")


def command(answers: Answers) -> str:
    """The command that goes on with this walk."""
    return f"adaptsim setup {answers.config.same_lab}"


def _touches(answers: Answers) -> bool:
    from sim.tasks import get_task

    return get_task(answers.config.task).require_hardware().touchable is not None


def _still_done(answers: Answers, step: Step) -> bool:
    """Whether the step was done earlier, and its check still passes."""
    if step.name not in answers.known.read().steps:
        return False
    found = tuple(_found(answers, step))
    examination.show_few(found, answers.screen)
    return not examination.missing_in(found)


def _do(answers: Answers, step: Step) -> None:
    """Do the step until nothing is missing. Raises StoppedByOperator."""
    screen, asks = answers.screen, True
    while True:
        if asks and not (step.practised and answers.config.is_simulated):
            step.does(answers)
            answers.save()
        found = tuple(_found(answers, step))
        examination.show_few(found, screen)
        if not examination.missing_in(found):
            return
        if answers.defaults:
            examination.require(found)
        again = enter("to check again", "Nothing is asked; the check runs again, after you have mended what it names.")
        other = Key("a", "to answer again", "The questions of this step are asked again.")
        answer = screen.choose("Not ready yet.", again, other, stop("The command ends; the same command goes on."))
        if answer == "q":
            raise StoppedByOperator("stopped by the operator; every completed step is kept")
        asks = answer == "a"


def _found(answers: Answers, step: Step) -> Iterable[Finding]:
    if step.practised and answers.config.is_simulated:
        return (checks.skipped(checks.DEVICES, step.name, f"simulated. A real lab {step.practised}"),)
    with answers.screen.busy("Checking"):
        return tuple(step.checks(answers))
