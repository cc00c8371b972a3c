"""The `adaptsim` program: the commands, and the one place that turns errors into exit codes.

Nothing heavy is imported here or by the command modules: each command imports what it needs when it runs.
"""

from __future__ import annotations

import inspect
import io
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperGroup

from adaptsim_cli.commands import (
    benchmark,
    calibrate,
    checkpoints,
    config,
    dashboard,
    exporting,
    lab,
    own_object,
    pretrain,
    rollout,
    run_iteration,
    sessions,
    setup,
    task,
    touch_off,
)
from adaptsim_cli.screen import loading
from adaptsim_cli.screen.pages import addressed

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

PANELS: Mapping[str, Mapping[str, Callable[..., Any] | typer.Typer]] = {
    "Set up": {
        "setup": setup.setup,
        "doctor": setup.doctor,
        "calibrate": calibrate.app,
        "touch-off": touch_off.app,
        "parts": setup.parts,
        "task": task.app,
        "config": config.app,
    },
    "Run": {
        "run-iteration": run_iteration.run_iteration,
        "rollout": rollout.rollout,
        "preview": rollout.preview,
    },
    "Look": {
        "report": exporting.report,
        "compare": exporting.compare,
        "dashboard": dashboard.dashboard,
        "sessions": sessions.app,
        "replay": exporting.replay,
        "lab": lab.app,
    },
    "Research": {
        "benchmark": benchmark.benchmark,
        "pretrain": pretrain.pretrain,
        "object": own_object.own_object,
        "checkpoints": checkpoints.app,
        "world-tables": benchmark.world_tables,
    },
    "Maintain": {
        "bundle": exporting.bundle,
        "retrack": exporting.retrack,
        "schema": config.schema,
    },
}
"""Every command, by the panel of the help that shows it, in this order."""


class _InOrder(TyperGroup):
    def list_commands(self, ctx: Any) -> list[str]:
        """See typer: the order of `PANELS`, not commands first."""
        return [name for commands in PANELS.values() for name in commands]


app = typer.Typer(
    name="adaptsim",
    cls=_InOrder,
    help=QUICK_START,
    epilog=EXIT_CODES,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _unwrapped(doc: str | None) -> str:
    """A docstring with each paragraph on one line: only the terminal wraps it."""
    return "\n\n".join(" ".join(part.split()) for part in inspect.cleandoc(doc or "").split("\n\n"))


def _register() -> None:
    for panel, commands in PANELS.items():
        for name, command in commands.items():
            if not isinstance(command, typer.Typer):
                app.command(name, rich_help_panel=panel, help=_unwrapped(command.__doc__))(command)
                continue
            for one in command.registered_commands:
                assert one.callback is not None, "a command has a function"
                one.help = _unwrapped(one.help or one.callback.__doc__)
            if (alone := command.registered_callback) is not None and alone.callback is not None:
                alone.help = _unwrapped(alone.callback.__doc__)
            app.add_typer(command, name=name, rich_help_panel=panel)


_register()


_QUICK = frozenset(("-h", "--help", "--version"))
"""Options that load nothing else."""


def _version(flag: bool) -> None:
    if flag:
        from importlib.metadata import version

        typer.echo(f"adaptsim {version('adaptsim')}")
        raise typer.Exit


def openers() -> Openers:
    """What commands open; the only place of the command line that knows labs, trackers and own robots by name."""
    from adaptsim_cli.session import opening
    from adaptsim_cli.session.target import Openers

    return Openers(opening.open_parts, opening.seen_by_camera)


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
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal without Unicode
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # small matrices: a second thread costs more than it saves
    sys.exit(run())


def documented_errors() -> tuple[type[BaseException], ...]:
    """The errors that `run` turns into a message and an exit code; any other error is a defect."""
    return tuple(kind for kind, _ in _codes())


def exit_code(error: BaseException) -> int:
    """The documented exit code of one of the `documented_errors`."""
    return next(code for kind, code in _codes() if isinstance(error, kind))


def _codes() -> tuple[tuple[type[BaseException], int], ...]:
    import calib.errors
    import hw.errors
    import perception.errors
    import sim.errors
    from adaptsim_cli import errors

    return (
        (errors.UsageError, 2),
        (sim.errors.UnknownName, 2),
        (sim.errors.NoHardware, 2),
        (sim.errors.MomentsMissing, 2),
        (sim.errors.TaskError, 2),
        (sim.errors.WorldError, 2),
        (sim.errors.OutOfRange, 2),
        (sim.errors.ObjectError, 2),
        (errors.PreflightFailed, 3),
        (hw.errors.DeviceUnavailable, 3),
        (hw.errors.BalanceError, 3),
        (hw.errors.HandError, 3),
        (sim.errors.ClusterUnavailable, 3),
        (sim.errors.ExtraMissing, 3),
        (calib.errors.ViewFolderError, 8),
        (calib.errors.CalibrationError, 3),
        (hw.errors.Rehearsed, 7),
        (hw.errors.MotionRefused, 4),
        (sim.errors.NotExecutable, 4),
        (hw.errors.StoppedByPedal, 7),
        (hw.errors.ArmFault, 5),
        (hw.errors.CameraError, 6),
        (perception.errors.PerceptionError, 6),
        (errors.StoppedByOperator, 7),
        (errors.AnswerAwaited, 7),
        (errors.AnswerRefused, 8),
        (errors.SessionError, 8),
        (sim.errors.RecordingsRefused, 8),
        (sim.errors.DatasetError, 8),
        (sim.errors.CheckpointError, 8),
        (sim.errors.SimError, 1),  # any other failure of a simulation
        (OSError, 8),  # a full or write-protected disk
        (errors.Interrupted, 130),
        (KeyboardInterrupt, 130),
    )


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
