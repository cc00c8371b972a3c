"""How a command is declared: by the names of its settings and by its own options. It returns a `Reply`.

    @command("task", "world", "seed", "hw")
    def report(screen: Screen, resolved: Resolved, out: options.Out = None) -> Reply:

This place opens the screen, loads the settings, and prints the reply: as JSON with `--json`, else for a person.
"""

from __future__ import annotations

import gc
import inspect
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, get_args, get_type_hints

import typer
from typer.models import ArgumentInfo

from adaptsim_cli.commands import options

if TYPE_CHECKING:
    from adaptsim_cli.config import Resolved
    from adaptsim_cli.screen.reply import Reply

_PROVIDED = ("screen", "resolved", "openers")
"""Parameters that no option fills: the terminal, the settings with their origins, and what `app` opens for commands."""


def command(
    *settings: str, with_json: bool = True, **own_words: Any
) -> Callable[[Callable[..., Reply]], Callable[..., None]]:
    """Make a command of typer from a function that returns its reply.

    `settings` are names of `options.SETTINGS`: each becomes an option, and `resolved` has its value. `own_words` are
    options of settings with another help text. The world decides the task, if the command takes a world.
    """
    declared = {name: options.SETTINGS[name] for name in settings} | own_words

    def declare(function: Callable[..., Reply]) -> Callable[..., None]:
        inputs = inspect.signature(function).parameters
        unloaded = dict.fromkeys(("Screen", "Resolved", "Openers", "Reply"), Any)
        hints = get_type_hints(function, localns=unloaded, include_extras=True)
        own = [_parameter(name, hints[name], p.default) for name, p in inputs.items() if name not in _PROVIDED]
        switches = {name for name, kind in declared.items() if get_args(kind)[0] is bool}
        parameters = [_parameter(name, kind, False if name in switches else None) for name, kind in declared.items()]
        parameters = [*filter(_is_argument, own), *parameters, *(p for p in own if not _is_argument(p))]
        if with_json:
            parameters.append(_parameter("as_json", options.Json, False))

        def run(invocation: typer.Context, as_json: bool = False, **values: Any) -> None:
            if invocation.invoked_subcommand is not None:
                return
            from adaptsim_cli.screen.console import Screen

            screen = Screen(as_json=as_json)
            flags = {name: values.pop(name) for name in declared}
            if "screen" in inputs:
                values["screen"] = screen
            if "resolved" in inputs:
                values["resolved"] = _resolved(flags)
            if "openers" in inputs:
                values["openers"] = invocation.obj()
            if not gc.isenabled():  # `main` paused it
                gc.freeze()  # what is loaded stays, so no collection looks through it
                gc.enable()
            screen.end(invocation.command_path.partition(" ")[2], function(**values))

        run.__name__, run.__doc__, run.__module__ = function.__name__, function.__doc__, function.__module__
        signature = inspect.Signature([_parameter("invocation", typer.Context), *parameters])
        run.__signature__ = signature  # type: ignore[attr-defined]
        run.__annotations__ = {name: p.annotation for name, p in signature.parameters.items()}
        return run

    return declare


def _parameter(name: str, annotation: Any, default: Any = inspect.Parameter.empty) -> inspect.Parameter:
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, annotation=annotation, default=default)


def _is_argument(parameter: inspect.Parameter) -> bool:
    return any(isinstance(one, ArgumentInfo) for one in get_args(parameter.annotation))


def _resolved(flags: dict[str, Any]) -> Resolved:
    """The settings, with the flags that were given. A switch that is off counts as not given."""
    from adaptsim_cli import config
    from adaptsim_cli.bench.checkpoints import resolve
    from adaptsim_cli.commands import settings

    on = {name: value for name, value in flags.items() if value is not False}
    if "world" in flags:
        return settings.load(on)
    return resolve(on) if "task" in flags else config.load(on)
