"""`adaptsim object`: an own object in one command."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from adaptsim_cli.commands import options
from adaptsim_cli.commands.command import command
from adaptsim_cli.screen.reply import Reply
from hw.bounded import encode_image

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from rich.console import RenderableType

    from adaptsim_cli.config import Resolved
    from adaptsim_cli.screen.console import Screen
    from sim.tasks.own_object import OwnObject
    from sim.tasks.task import Task
    from sim.types import Space

_Ranges = list[str] | None


@command("task", "seed", "workers")
def own_object(
    screen: Screen,
    resolved: Resolved,
    name: Annotated[str, typer.Argument(help="Name of the object; its file is NAME.toml in the current folder.")],
    ranges: Annotated[
        _Ranges,
        typer.Option("--range", help="Range of a parameter as name=low:high; may be repeated. Names: lab list."),
    ] = None,
    sizes: Annotated[_Ranges, typer.Option("--size", help="Range of a size as name=low:high; may be repeated.")] = None,
    mass: Annotated[float | None, typer.Option("--mass", help="What the object weighs, kg.", min=1e-4)] = None,
    effect: Annotated[
        _Ranges,
        typer.Option("--effect", help="Effect of the scene as name=value, as in a world's file; may be repeated."),
    ] = None,
    rollouts: Annotated[
        int | None,
        options.advanced("--rollouts", "Simulated trials to learn from, if it is another scene.", min=64),
    ] = None,
    scheduler: options.Scheduler = "",
) -> Reply:
    """Describe an object of your own, draw it, and make its checkpoint from the shipped one.

    Without values it asks; a NAME.toml that exists is used as it is, and an interrupted run goes on. With narrower
    ranges alone nothing is learnt: the shipped emulator serves them. An object of another size or mass is learnt,
    beginning with the shipped emulator.

    Example: adaptsim object tofu --task scooping --range mu=0.30:0.40 --range h=2.0:2.6
    """
    from adaptsim_cli.errors import UsageError
    from adaptsim_cli.research.pretraining import object_ready, to_learn
    from adaptsim_cli.research.working import simulations
    from adaptsim_cli.screen import views
    from adaptsim_cli.storage import durable
    from sim.tasks import get_task
    from sim.tasks.own_object import as_toml, load_object, with_ranges

    usual = get_task(resolved.config.task)
    file, picture = Path(f"{name}.toml"), Path(f"{name}.png")
    is_typed = any((ranges, sizes, mass, effect))
    if file.exists() and not is_typed:
        own = load_object(file)
    else:
        own = _typed(name, usual, ranges, sizes, mass, effect) if is_typed else _asked(screen, name, usual)
        with_ranges(usual, own)  # raises before anything is written
        if not file.exists():
            durable.write_file(file.absolute(), as_toml(usual, own).encode())
        elif load_object(file) != own:
            raise UsageError(
                f"{file} describes another object: leave the values out to use it as it is, or choose another name"
            )
    chosen = resolved.config.model_copy(update={"task": own.task, "object": str(file)})
    own_task = with_ranges(get_task(own.task), own)
    drawn = own_task.hardware is not None
    if drawn:
        with screen.busy("Drawing the object"):
            durable.replace_file(picture.absolute(), _png(own_task))
    if count := to_learn(chosen, rollouts):
        screen.plain(
            f"Another scene than in training ({', '.join(_beyond(own, get_task(own.task)))}): {count:,} rollouts are "
            "simulated, then learnt. The time left is shown after the first ones. Ctrl-C: the same command goes on."
        )
    with screen.progress() as progress, simulations(resolved, scheduler, screen) as crew:
        ready = object_ready(resolved, chosen, rollouts, crew, progress)
    data = {"object": name, "file": str(file), "picture": str(picture) if drawn else None, **ready}
    body = [(p["title"], views.number(p["left"]), p["words"]) for p in ready["parameters"]]
    text: list[RenderableType] = [
        f"Object: {file}" + (f", picture: {picture}" if drawn else ""),
        views.rows(("parameter", "share of error left", "after a session of 8 trials"), body, right=(1,)),
        "Inside the margin: nothing to learn." if ready["inside"] else "Another scene: learnt.",
    ]
    if (held_out := ready["held_out"]) is not None:
        text.append(
            f"On {held_out['rollouts']} fresh rollouts: {100 * held_out['accuracy']:.0f} % of outcomes right, "
            f"last position {1e3 * held_out['position_error_median']:.1f} mm off (median)."
        )
    steps = [
        (f"adaptsim run-iteration {chosen.same_task}", "a session with it"),
        (f"xdg-open {picture}" if drawn else f"cat {file}", "is it your object?"),
    ]
    return Reply(data, text, steps)


def _beyond(own: OwnObject, task: Task) -> list[str]:
    """The differences between the scene of the object and that of training, by option."""
    trained = {d.name: d for d in task.nuisance.dimensions}
    sizes = {key: (low, high) for key, (low, high) in own.sizes.items() if key in trained}
    wider = [key for key, (low, high) in sizes.items() if low < trained[key].low or high > trained[key].high]
    weighs = ["--mass"] if own.mass_kg is not None else []
    return [*(f"--size {key}" for key in wider), *weighs, *(f"--effect {key}" for key in own.effects)]


def _typed(name: str, task: Task, ranges: _Ranges, sizes: _Ranges, mass: float | None, effects: _Ranges) -> OwnObject:
    from sim.tasks.own_object import OwnObject

    parameters, nuisance = (
        {key: _range(key, text) for key, text in _split(options or ())} for options in (ranges, sizes)
    )
    scene = {key: _numbers(key, text) for key, text in _split(effects or ())}
    return OwnObject(task.name, name, parameters, nuisance, mass, scene)


def _split(options: Iterable[str]) -> Iterable[tuple[str, str]]:
    from adaptsim_cli.errors import UsageError

    for text in options:
        key, equals, value = text.partition("=")
        if not equals:
            raise UsageError(f"{text}: write name=low:high, for example h=2.0:2.6")
        yield key.strip(), value.strip()


def _range(key: str, text: str) -> tuple[float, float]:
    from adaptsim_cli.errors import UsageError

    try:
        low, high = map(float, text.replace(",", ".").split(":"))
    except ValueError as error:
        raise UsageError(f"{key}={text}: write the two ends of the range as low:high, for example 2.0:2.6") from error
    return low, high


def _numbers(key: str, text: str) -> Any:
    from adaptsim_cli.errors import UsageError

    try:
        values = tuple(float(part) for part in text.split(":"))
    except ValueError as error:
        raise UsageError(f"{key}={text}: write a number, or several with colons between") from error
    return values if len(values) > 1 else values[0]


def _asked(screen: Screen, name: str, task: Task) -> OwnObject:
    """The answers of a person; Enter keeps the task's range."""
    from adaptsim_cli.screen import console
    from sim.tasks.own_object import OwnObject

    console.require_terminal("there is no terminal to ask at: give --range, --size or --mass")
    ranges, sizes = (_answers(screen, space) for space in (task.parameters, task.nuisance))
    weighs = task.hardware is not None and task.hardware.weighing is not None
    return OwnObject(task.name, name, ranges, sizes, _mass(screen) if weighs else None)


def _mass(screen: Screen) -> float | None:
    while answer := screen.ask("Mass in kg (Enter: as in training)?"):
        with suppress(ValueError):
            return float(answer.replace(",", "."))
        screen.note(f"  {answer} is not a number; for example 0.4")
    return None


def _answers(screen: Screen, space: Space) -> Mapping[str, tuple[float, float]]:
    from adaptsim_cli.errors import UsageError

    ranges = dict[str, tuple[float, float]]()
    for d in space.dimensions:
        while answer := screen.ask(f"{d.title}, low:high (Enter: {d.low:g}:{d.high:g})?"):
            try:
                ranges[d.name] = _range(d.name, answer)
                break
            except UsageError as error:
                screen.note(f"  {error}")
    return ranges


def _png(task: Task) -> bytes:
    """Three panels side by side, each with its name and a scale bar."""
    import cv2
    import numpy as np

    from sim.lab.preview import low_middle_high

    panels = []
    for name, picture in zip(
        ("all at the lower end", "middle", "all at the upper end"), low_middle_high(task), strict=True
    ):
        panel = np.ascontiguousarray(picture.rgb[..., ::-1])
        bar_mm = next(mm for mm in (100, 50, 20, 10, 5, 2, 1) if mm * picture.px_per_m < 0.4e3 * len(panel))
        end = 16 + round(bar_mm * picture.px_per_m / 1e3)
        height = len(panel) - 16
        cv2.line(panel, (16, height), (end, height), (20, 20, 20), 3)
        cv2.putText(
            panel, f"{bar_mm} mm", (16, height - 10), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (20, 20, 20), 1, cv2.LINE_AA
        )
        strip = np.full((32, panel.shape[1], 3), 255, np.uint8)
        cv2.putText(strip, name, (16, 22), cv2.FONT_HERSHEY_SIMPLEX, 0.55, (20, 20, 20), 1, cv2.LINE_AA)
        panels.append(cv2.vconcat([strip, panel]))
    return encode_image(cv2.hconcat(panels), ".png")
