"""The `adaptsim` program: the commands, and the one place that turns errors into exit codes.

A command's module is imported when the command is called, and its own imports happen when it runs.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated

import typer

from adaptsim_cli.commands.rows import HELP, CommandGroup, CommandRow
from adaptsim_cli.screen import loading
from adaptsim_cli.screen.exit_codes import documented_errors, exit_code
from adaptsim_cli.screen.pages import addressed
from adaptsim_cli.screen.pipes import outlast_readers

if TYPE_CHECKING:
    from adaptsim_cli.session.target import Openers

EXIT_CODES = (
    "Exit codes: 0 done, 1 a simulation failed, 2 usage or configuration, 3 preflight failed, "
    "4 motion refused by limits, 5 robot fault, "
    "6 camera or tracking, 7 stopped by the operator, 8 corrupt or missing data, 130 interrupted."
)

QUICK_START = f"""Adapt simulation parameters to a real robot task in about twenty trials.

Quick start:
  adaptsim run-iteration --task scooping --world cucumber --yes -n 2
  adaptsim report
  adaptsim setup          with an arm of your own

Documentation: {addressed("docs/README.md")}
"""

PANELS: Mapping[str, Mapping[str, CommandRow]] = {
    "Set up": {
        "setup": CommandRow(
            "setup:setup", "Set up a lab: from an unpacked arm to the first trial, with a check after every step."
        ),
        "doctor": CommandRow(
            "setup:doctor",
            "Check everything that an iteration needs, and give the remedy for whatever is missing. Nothing moves.",
        ),
        "calibrate": CommandRow(
            "calibrate:app",
            "Find the camera's pose: the arm shows the camera a board from many sides. Takes about ten minutes.",
        ),
        "touch-off": CommandRow(
            "touch_off:app", "Measure the table and the tool's pose in the hand. Do this before the first scoop."
        ),
        "find": CommandRow(
            "find:find",
            "Find cameras, serial ports and the arm, and say where each belongs in the rig file. Nothing moves.",
        ),
        "parts": CommandRow(
            "setup:parts",
            "Write the parts that a lab prints: pusher, adapter of the turner, holder of the board, and a sheet.",
        ),
        "task": CommandRow("task:app", "A task of your own, in one file."),
        "config": CommandRow("config:app", "Settings, and where each comes from."),
    },
    "Run": {
        "run-iteration": CommandRow(
            "run_iteration:run_iteration",
            "Run the trials of one iteration, adapt the simulation parameters and train the next task policies.",
        ),
        "rollout": CommandRow(
            "rollout:rollout",
            "Execute one trial with a chosen action, or with the action of a policy. Nothing is adapted.",
        ),
        "preview": CommandRow(
            "preview:preview",
            "Plan one motion, show how close it comes to each limit, and play it in the browser. Nothing moves.",
        ),
    },
    "Look": {
        "report": CommandRow(
            "exporting:report",
            "Write one self-contained HTML page of a session: is it better, rewards, parameters, paths, camera frames.",
        ),
        "compare": CommandRow(
            "exporting:compare",
            "Compare sessions: methods, worlds, days, posteriors. "
            "Writes a page, and CSV of the sessions and of the trials.",
        ),
        "dashboard": CommandRow(
            "dashboard:dashboard",
            "Show all sessions in the browser: search, tags, learning curves side by side, "
            "and the running session live.",
        ),
        "sessions": CommandRow("sessions:app", "List, check, mark, correct, prune and export stored sessions."),
        "replay": CommandRow(
            "exporting:replay",
            "Watch a recorded trial: a video with the tracked centre, or the Rerun viewer with the moving arm.",
        ),
        "lab": CommandRow("lab:app", "The simulated lab and its worlds."),
    },
    "Research": {
        "benchmark": CommandRow(
            "benchmark:benchmark",
            "Compare methods: the same worlds, contexts, noise and budget of real trials for all, "
            "scored by fresh rollouts.",
        ),
        "pretrain": CommandRow(
            "pretrain:pretrain",
            "Phase 1: simulate a dataset, fit the emulator, tabulate the rewards, write a checkpoint.",
        ),
        "object": CommandRow(
            "own_object:own_object",
            "Describe an object of your own, draw it, and make its checkpoint from the shipped one.",
        ),
        "checkpoints": CommandRow("checkpoints:app", "The pretrained policies."),
        "world-tables": CommandRow(
            "benchmark:world_tables",
            "Simulate the tables in which a benchmark looks up its trials: about a minute of one core a world.",
        ),
    },
    "Maintain": {
        "bundle": CommandRow(
            "exporting:bundle",
            "Pack a session for a bug report: records, versions, settings. Pictures stay out unless asked for.",
        ),
        "retrack": CommandRow(
            "exporting:retrack",
            "Track the recordings of a session again, with the tracker of this version. Nothing stored is changed.",
        ),
        "explain": CommandRow(
            "explain:explain", "Say what a message means: what happened, what the arm did, and what to do next."
        ),
        "schema": CommandRow(
            "config:schema",
            "Print the JSON schema of the output of a command with --json: names, types, units, meanings.",
        ),
    },
}
"""Every command, by its panel of the help, in this order: its module and its sentence."""


class _Program(CommandGroup):
    panels = PANELS


app = typer.Typer(
    name="adaptsim",
    cls=_Program,
    help=QUICK_START,
    epilog=EXIT_CODES,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": list(HELP)},
)


_QUICK = frozenset((*HELP, "--version"))
"""Options that load nothing else."""


def _version(flag: bool) -> None:
    if flag:
        from importlib.metadata import version

        typer.echo(f"adaptsim {version('adaptsim')}")
        raise typer.Exit


def openers() -> Openers:
    """The functions that open things for commands. No other place of the command line names labs, trackers and own
    robots.
    """
    from adaptsim_cli.bench.devices.trackers import tracker_of
    from adaptsim_cli.session import opening
    from adaptsim_cli.session.target import Openers

    return Openers(opening.open_parts, opening.seen_by_camera, tracker_of)


@app.callback()
def options(
    context: typer.Context,
    debug: Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")] = False,
    version: Annotated[
        bool, typer.Option("--version", help="Show the version and exit.", callback=_version, is_eager=True)
    ] = False,
) -> None:
    """Options before a command."""
    context.obj = openers
    if debug:
        os.environ["ADAPTSIM_DEBUG"] = "1"


def run(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code. A defect of the program itself raises with its traceback."""
    words = sys.argv[1:] if arguments is None else arguments
    for size in ("COLUMNS", "LINES"):  # of a terminal; 0 would print nothing
        if not os.environ.get(size, "1").strip("0").isdigit():
            del os.environ[size]
    if words and not _QUICK.intersection(words):
        loading.say()
    try:
        code = app(arguments, standalone_mode=False, prog_name="adaptsim")
    except typer.TyperException as error:  # a wrong command line
        if message := error.format_message():  # empty if help was shown
            _say(message.replace("Input should be", "it must be") + _example(error))
        return error.exit_code
    except documented_errors() as error:
        return _explain(error)
    if code == 130:
        _say("interrupted")
    return code if isinstance(code, int) else 0


def main() -> None:
    """The console script."""
    outlast_readers()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # small matrices: a second thread costs more than it saves
    sys.exit(run())


def _explain(error: BaseException) -> int:
    """Print the error on stderr and return the exit code."""
    if os.environ.get("ADAPTSIM_DEBUG"):
        import traceback

        traceback.print_exception(error)
    from adaptsim_cli.errors import Interrupted, StoppedByOperator
    from adaptsim_cli.screen import console
    from hw.errors import Rehearsed

    by_person = isinstance(error, StoppedByOperator | Interrupted | KeyboardInterrupt | Rehearsed)
    say = console.ended if by_person else console.error
    say("\n".join([str(error) or "interrupted", *getattr(error, "__notes__", ())]))
    return exit_code(error)


def _example(error: typer.TyperException) -> str:
    """A line with the example from the command's help; "" if it has none."""
    context = getattr(error, "ctx", None)
    text = (context.command.help if context is not None else None) or ""
    _, separator, example = text.partition("Example: ")
    return f"\nExample: {example.splitlines()[0]}" if separator else ""


def _say(message: str) -> None:
    from adaptsim_cli.screen import console

    console.error(message)
