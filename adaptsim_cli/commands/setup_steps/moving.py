"""The steps that use the devices. Each step is the function of a separate command, and continues like that command."""

from __future__ import annotations

from contextlib import ExitStack, suppress
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from adaptsim_cli.bench import calibration_in_use as calibration
from adaptsim_cli.bench import touch_off_in_use as touch_off
from adaptsim_cli.bench.calibration import printing
from adaptsim_cli.bench.calibration import running as calibrating
from adaptsim_cli.bench.devices.consent import SLOW_PACE
from adaptsim_cli.bench.devices.opening import open_lab
from adaptsim_cli.bench.motion import mounted_for
from adaptsim_cli.bench.touch_off import guiding
from adaptsim_cli.commands.setup_steps.answers import Answers
from adaptsim_cli.commands.setup_steps.describing import board_payload
from adaptsim_cli.config import Resolved
from adaptsim_cli.screen.keys import Key, enter
from adaptsim_cli.session import rig_sessions, single
from adaptsim_cli.session.history import trials_of
from adaptsim_cli.session.opening import open_parts
from hw.errors import Rehearsed

BOARD_PDF = Path("board.pdf")
_PAPER = "The paper in your printer. The board is printed at its true size; a3 is seen better from far away."


def board(answers: Answers) -> None:
    """Print the calibration board, unless there is one already; ask for its measured size and its weight."""
    screen, data = answers.screen, answers.places.data
    record = printing.stored_board(data)
    if record is None:
        paper = answers.one_of("Paper for the calibration board?", tuple(printing.PAPERS_MM), "a4", _PAPER)
        calibrating.board(answers.resolved, BOARD_PDF, paper, None, None, screen)
        if not answers.defaults:
            screen.go_on("Print it, and glue it to something stiff and flat.", "when done", then="Nothing moves.")
    measured = calibrating.board_in_use(answers.resolved, screen, yes=answers.defaults)
    board_payload(answers, calibration.held_board(measured).mass_F)


def calibrate(answers: Answers) -> None:
    """Find the camera: the first time on a real rig by hand, since nothing can be planned yet."""
    config, screen = answers.config, answers.screen
    record = calibration.current_calibration(config, answers.places)
    if record is not None and not answers.defaults:
        keep = enter("to keep it", "The step is done.")
        again = Key("r", "to calibrate again", "A new calibration begins.")
        if screen.choose(f"A calibration of {record.created} is in use.", keep, again) == "":
            return
    calibrating.calibrate(
        _slowly(answers, practice=False),
        calibration.calibrations(config, answers.places),
        rig_sessions.open_sessions(config, answers.places),
        partial(calibration.open_calibration_rig, screen=answers.prompt_screen),
        screen,
        guide=record is None and not config.is_simulated,
        yes=answers.defaults,
    )


def touch(answers: Answers) -> None:
    """Find table and tool: the tool is set down by hand."""
    config, screen = answers.config, answers.screen
    guiding.run(
        answers.resolved,
        touch_off.grasp_of(config),
        touch_off.touch_offs(config, answers.places),
        rig_sessions.open_sessions(config, answers.places),
        partial(touch_off.open_guided_rig, screen=answers.prompt_screen),
        screen,
        yes=answers.defaults,
    )


def stop(answers: Answers) -> None:
    """Measure how the arm's stop button stops a slow motion."""
    from sim.tasks import get_task

    mounted_task = mounted_for(answers.resolved, None)
    with open_lab(answers.config, get_task(answers.config.task), screen=answers.prompt_screen) as lab:
        answers.screen.plain(f"  {lab.measure_stop(mounted_task)}")


def slow_motion(answers: Answers) -> None:
    """One trial in slow motion."""
    with suppress(Rehearsed):
        _trial(_slowly(answers), answers)


def trial(answers: Answers) -> None:
    """One trial at full speed."""
    _trial(answers.resolved, answers)


def _trial(resolved: Resolved, answers: Answers) -> None:
    config, screen = resolved.config, answers.screen
    folder = resolved.places.sessions / f"rollout-{config.task}-{datetime.now(UTC):%Y%m%d-%H%M%S-%f}"
    with TemporaryDirectory() as learnt, ExitStack() as stack:
        with screen.busy("Loading the task, the policies and the devices", "loading"):
            parts = stack.enter_context(open_parts(config, Path(learnt), screen=answers.prompt_screen))
        store = single.rollout(config, parts, single.Chosen(), screen, folder, yes=answers.defaults)
    for record in trials_of(store):
        screen.plain(f"  {record.outcome_words}, reward {record.reward:.2f}, stored: {folder}")


def _slowly(answers: Answers, *, practice: bool = True) -> Resolved:
    """The settings for a set-up that has not moved yet. The simulated lab is slow only to `practice` it."""
    config = answers.config
    if config.is_simulated and not practice:
        return answers.resolved
    return replace(answers.resolved, config=config.model_copy(update={"pace": min(config.pace, SLOW_PACE)}))
