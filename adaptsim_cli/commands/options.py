"""The options that several commands take, each declared once, and the names that a shell completes for them.

Light, because every press of Tab starts the program.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib.metadata import entry_points
from pathlib import Path
from typing import Annotated, Any

import typer

_WORLDS = Path(__file__).parents[2] / "sim/worlds"


def session_names(incomplete: str) -> list[str]:
    """Sessions of this machine that begin like this."""
    return _folders("sessions", incomplete)


def task_names(incomplete: str) -> list[str]:
    """Tasks that begin like this, those of installed packages and of files too."""
    ours = {file.parent.name for file in _WORLDS.glob("*/*.toml")}
    packaged = {entry.name for entry in entry_points(group="adaptsim.tasks")}
    return sorted({*_like(incomplete, ours | packaged), *_folders("tasks", incomplete, ".toml")})


def world_names(incomplete: str) -> list[str]:
    """Shipped worlds of all our tasks that begin like this; the shell completes files itself."""
    return _like(incomplete, {file.stem for file in _WORLDS.glob("*/*.toml")})


def method_names(incomplete: str) -> list[str]:
    """Methods that begin like this."""
    from sim.adaptation.methods import REGISTRY

    return _like(incomplete, set(REGISTRY.names()))


def control_names(incomplete: str) -> list[str]:
    """Methods and sessions whose policies can make control trials, that begin like this."""
    return sorted({*method_names(incomplete), *session_names(incomplete)})


def hardware_names(incomplete: str) -> list[str]:
    """Values of --hw that begin like this."""
    from typing import get_args

    from adaptsim_cli.config import Config

    return _like(incomplete, set(get_args(Config.model_fields["hw"].annotation)))


def _folders(kind: str, incomplete: str, suffix: str = "") -> list[str]:
    from adaptsim_cli import config

    folder = config.places().data / kind
    entries = folder.iterdir() if folder.is_dir() else ()
    return _like(incomplete, {entry.name.removesuffix(suffix) for entry in entries})


def _like(incomplete: str, names: set[str]) -> list[str]:
    return sorted(name for name in names if name.startswith(incomplete) and not name.startswith("."))


ROBOT, ADVANCED = "Robot", "Advanced"
"""Panels of the help, below the usual options."""


def robot(flag: str, meaning: str, **rules: Any) -> Any:
    """An option in the panel of the robot."""
    return typer.Option(flag, help=meaning, rich_help_panel=ROBOT, **rules)


def advanced(flag: str, meaning: str, **rules: Any) -> Any:
    """An option in the last panel, which few people need."""
    return typer.Option(flag, help=meaning, rich_help_panel=ADVANCED, **rules)


Task = Annotated[
    str | None,
    typer.Option(
        "--task",
        autocompletion=task_names,
        show_default="scooping",
        help="Which task, e.g. scooping; or the Python file of your own.",
    ),
]
World = Annotated[
    str | None,
    typer.Option(
        "--world", autocompletion=world_names, show_default="wd", help="World of the simulated lab: name or TOML file."
    ),
]
Seed = Annotated[int | None, typer.Option("--seed", show_default="0", help="Seed of all random numbers.")]
Hw = Annotated[
    str | None,
    robot(
        "--hw", "Which hardware: fake, panda, fr3, fr3v2 or own.", autocompletion=hardware_names, show_default="fake"
    ),
]
AnswerWith = Annotated[
    str | None,
    robot("--answer-with", "With --hw own: the program that answers, or person.", metavar="COMMAND"),
]
AnswerMoves = Annotated[
    str | None,
    robot("--answer-moves", "What that program moves: robot (each trial confirmed) or nothing.", show_default="robot"),
]
Object = Annotated[
    str | None, typer.Option("--object", help="TOML file of your own object, or a shipped one, e.g. blunt-edge.")
]
Solver = Annotated[
    str | None,
    advanced("--solver", "How task policies are found: emulator, naf, or direct (without Phase 1)."),
]
Recorded = Annotated[
    str | None,
    advanced("--recorded", "Folder of recorded trials that replace the lab."),
]
HeldOut = Annotated[
    float | None,
    advanced("--held-out", "Fraction of the recorded trials held out for scoring, 0 to 0.9.", show_default="0.5"),
]
Context = Annotated[
    list[str] | None,
    typer.Option("--context", help="Context as name=value; may be repeated. Names: adaptsim lab list."),
]
Action = Annotated[
    list[str] | None,
    typer.Option("--action", help="Action as name=value; may be repeated. Names: adaptsim lab list."),
]

Yes = Annotated[bool, typer.Option("--yes", "-y", help="Ask nothing; refused for a real arm.")]
Sure = Annotated[bool, typer.Option("--yes", "-y", help="Do not ask.")]
Realtime = Annotated[bool, robot("--realtime", "Simulated lab: at the arm's own pace, to watch.")]
Pace = Annotated[
    float | None,
    robot("--pace", "Speed of every motion, 0.1 to 1; below 1 nothing counts.", show_default="1"),
]
Operator = Annotated[str | None, robot("--operator", "Your name, for the record of a real arm.")]
View = Annotated[bool, typer.Option("--view", help="Show camera, motion and track on a page of 127.0.0.1.")]
ViewPort = Annotated[
    int | None,
    advanced("--view-port", "Port of that page; implies --view.", min=1024, max=65535),
]

Workers = Annotated[
    int | None,
    advanced("--workers", "Number of processes; 0: one per usable core.", show_default="0"),
]
Scheduler = Annotated[
    str,
    advanced("--scheduler", "Simulate on the workers of this Dask scheduler, not on this computer.", metavar="ADDRESS"),
]
ShareOfWork = Annotated[
    str,
    advanced("--share", "Compute the K-th of N shares; the command without it joins them.", metavar="K/N"),
]
WorkingFolder = Annotated[Path | None, typer.Option("--out", help="Working folder; an unfinished run there continues.")]

StartFrom = Annotated[
    str | None,
    typer.Option("--start-from", autocompletion=session_names, help="Begin with the posterior of this session."),
]
Method = Annotated[
    str | None,
    typer.Option(
        "--method",
        autocompletion=method_names,
        show_default="adaptsim",
        help="How to adapt, e.g. adaptsim, udr or random.",
    ),
]
Control = Annotated[
    str | None,
    typer.Option(
        "--control",
        autocompletion=control_names,
        help="Add blind control trials by another method or session, e.g. udr.",
    ),
]
Pairs = Annotated[
    int | None,
    typer.Option("--pairs", help="Pairs planned for --control; 0: those of five iterations.", show_default="0"),
]

SETTINGS: Mapping[str, Any] = {
    "task": Task,
    "world": World,
    "seed": Seed,
    "hw": Hw,
    "method": Method,
    "control": Control,
    "pairs": Pairs,
    "solver": Solver,
    "object": Object,
    "recorded": Recorded,
    "held_out": HeldOut,
    "start_from": StartFrom,
    "answer_with": AnswerWith,
    "answer_moves": AnswerMoves,
    "realtime": Realtime,
    "pace": Pace,
    "operator": Operator,
    "workers": Workers,
}
"""The option of each setting that a flag may set (`config.Config`)."""

Out = Annotated[Path | None, typer.Option("--out", help="Where to write it.")]
Force = Annotated[bool, typer.Option("--force", help="Replace a file named by --out.")]
Json = Annotated[bool, typer.Option("--json", help="JSON on stdout.")]

Session = Annotated[str, typer.Argument(help="Name of the session.", autocompletion=session_names)]
NewestSession = Annotated[
    str | None, typer.Argument(help="Name of the session; default: the newest.", autocompletion=session_names)
]
Trial = Annotated[int, typer.Argument(min=1, help="Number of the trial, as `sessions show` lists it.")]
