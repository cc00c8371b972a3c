"""`adaptsim touch-off`, `touch-off list`, `touch-off restore`, `touch-off compare`."""

from __future__ import annotations

from typing import Annotated

import typer

app = typer.Typer()

_Task = Annotated[str | None, typer.Option("--task", help="Task with the tool: scooping.")]
_World = Annotated[str | None, typer.Option("--world", help="World of the simulated lab: name or TOML file.")]
_Seed = Annotated[int | None, typer.Option("--seed", help="Seed of all random numbers.")]
_Hw = Annotated[str | None, typer.Option("--hw", help="Which hardware: fake, panda or fr3.")]
_Realtime = Annotated[bool, typer.Option("--realtime", help="Simulated lab: at the arm's own pace, to watch.")]
_Pace = Annotated[
    float | None, typer.Option("--pace", help="Speed of every motion, 0.1 to 1, to watch a new rig first.")
]
_Operator = Annotated[str | None, typer.Option("--operator", help="Your name, for the record of a real arm.")]
_Json = Annotated[bool, typer.Option("--json", help="One JSON object on stdout.")]
_Name = Annotated[str, typer.Argument(help="Name or number, as `touch-off list` shows it.")]


@app.callback(invoke_without_command=True)
def touch_off(
    context: typer.Context,
    task: _Task = None,
    world: _World = None,
    seed: _Seed = None,
    hw: _Hw = None,
    grasp_force_N: Annotated[
        float, typer.Option("--grasp-force", min=5.0, max=70.0, help="Grasp force of the hand, N.")
    ] = 40.0,
    handle_mm: Annotated[
        float, typer.Option("--handle-mm", min=2.0, max=70.0, help="Width of the handle between the fingers, mm.")
    ] = 12.0,
    yes: Annotated[bool, typer.Option("--yes", "-y", help="Ask nothing; refused for a real arm.")] = False,
    realtime: _Realtime = False,
    pace: _Pace = None,
    operator: _Operator = None,
    as_json: _Json = False,
) -> None:
    """Find the table's height and the tool's pose in the hand by touching slowly. Do this before the first scoop.

    Planning uses the result from then on. Nothing is stored unless all touches agree.

    Example: adaptsim touch-off --task scooping --world steep-mount --seed 0 --yes
    """
    if context.invoked_subcommand is not None:
        return
    from functools import partial

    from adaptsim_cli.screen.console import Screen
    from adaptsim_cli.touch_off import running
    from adaptsim_cli.touch_off.parts import Grasp
    from adaptsim_cli.wiring import rig_frames, settings
    from adaptsim_cli.wiring import touch_off as wiring

    flags = {"task": task, "world": world, "seed": seed, "hw": hw, "realtime": realtime or None}
    resolved, screen = settings.load({**flags, "pace": pace, "operator": operator}), Screen(as_json=as_json)
    request = running.TouchOffRequest(Grasp(1e-3 * handle_mm, grasp_force_N), yes, as_json)
    open_rig = partial(wiring.open_touch_rig, screen=screen)
    running.touch_off(resolved, request, open_rig, wiring.touch_offs, rig_frames.open_sessions, screen)


@app.command("list")
def list_touch_offs(
    task: _Task = None, world: _World = None, seed: _Seed = None, hw: _Hw = None, as_json: _Json = False
) -> None:
    """List the touch-offs of a rig and task, oldest first, and the sessions that rest on the one in use.

    Example: adaptsim touch-off list --task scooping --hw fr3
    """
    from adaptsim_cli.screen import console
    from adaptsim_cli.touch_off import kept
    from adaptsim_cli.wiring import rig_frames, settings
    from adaptsim_cli.wiring import touch_off as wiring

    resolved = settings.load({"task": task, "world": world, "seed": seed, "hw": hw})
    store = wiring.touch_offs(resolved.config, resolved.places)
    screen, found = console.Screen(as_json=as_json), kept.listed(store)
    resting = rig_frames.open_sessions(resolved.config, resolved.places)
    if as_json:
        screen.data("touch-off list", {"rig": store.folder.name, "touch_offs": found, "open_sessions": list(resting)})
        return
    kept.tell(screen, store, found, resting)


@app.command("show")
def show_touch_off(
    name: _Name, task: _Task = None, world: _World = None, seed: _Seed = None, hw: _Hw = None, as_json: _Json = False
) -> None:
    """Show one touch-off: every value with its 95 % interval.

    Example: adaptsim touch-off show 1 --task scooping --hw fr3
    """
    from adaptsim_cli.screen import console, views
    from adaptsim_cli.touch_off import kept, running
    from adaptsim_cli.wiring import settings
    from adaptsim_cli.wiring import touch_off as wiring

    resolved = settings.load({"task": task, "world": world, "seed": seed, "hw": hw})
    store = wiring.touch_offs(resolved.config, resolved.places)
    path, screen = store.numbered.named(name), console.Screen(as_json=as_json)
    known = store.read(path)
    if as_json:
        screen.data("touch-off show", running.summary(known) | {"folder": str(path)})
        return
    screen.plain(f"{path.name}, made {known.created}, with {known.tool}")
    screen.show(views.rows(("quantity", "value", "95 % within"), kept.values(known), right=(1, 2)))
    again = f"adaptsim touch-off restore {path.name} {resolved.config.same_lab}"
    screen.next((again, "puts it in use again"))


@app.command("restore")
def restore_touch_off(
    name: _Name, task: _Task = None, world: _World = None, seed: _Seed = None, hw: _Hw = None, as_json: _Json = False
) -> None:
    """Put an earlier touch-off in use again, as a copy with the next number. Nothing is deleted.

    Names the open sessions that rest on the one in use until now.

    Example: adaptsim touch-off restore 1 --task scooping --hw fr3
    """
    from datetime import UTC, datetime

    from adaptsim_cli.screen import console, resting
    from adaptsim_cli.wiring import rig_frames, settings
    from adaptsim_cli.wiring import touch_off as wiring

    resolved = settings.load({"task": task, "world": world, "seed": seed, "hw": hw})
    store = wiring.touch_offs(resolved.config, resolved.places)
    screen = console.Screen(as_json=as_json)
    source = store.numbered.named(name)
    resting.tell_resting(screen, "the touch-off in use", rig_frames.open_sessions(resolved.config, resolved.places))
    path = store.numbered.restore(name, datetime.now(UTC).isoformat(timespec="seconds"))
    if as_json:
        screen.data("touch-off restore", {"in_use": path.name, "restored_from": source.name, "folder": str(path)})
        return
    screen.plain(f"In use from now on: {path}")
    screen.next((f"adaptsim rollout {resolved.config.same_lab}", "one trial with it"))


@app.command("compare")
def compare_touch_offs(
    first: _Name,
    second: _Name,
    task: _Task = None,
    world: _World = None,
    seed: _Seed = None,
    hw: _Hw = None,
    as_json: _Json = False,
) -> None:
    """Put the values of two touch-offs beside each other, with their difference.

    Example: adaptsim touch-off compare 1 2 --task scooping --hw fr3
    """
    from adaptsim_cli.screen import console, views
    from adaptsim_cli.touch_off import kept
    from adaptsim_cli.wiring import settings
    from adaptsim_cli.wiring import touch_off as wiring

    resolved = settings.load({"task": task, "world": world, "seed": seed, "hw": hw})
    store = wiring.touch_offs(resolved.config, resolved.places)
    screen, found = console.Screen(as_json=as_json), kept.compared(store, first, second)
    if as_json:
        screen.data("touch-off compare", found)
        return
    screen.show(views.rows(("quantity", "first", "second", "difference"), kept.differences(found), right=(1, 2, 3)))
    again = f"adaptsim touch-off restore {store.numbered.named(first).name} {resolved.config.same_lab}"
    screen.next((again, "puts the first in use again"))
