"""`adaptsim touch-off`."""

from __future__ import annotations

from typing import Annotated

import typer


def touch_off(
    task: Annotated[str | None, typer.Option("--task", help="Task with the tool: scooping.")] = None,
    world: Annotated[str | None, typer.Option("--world", help="World of the simulated lab: name or TOML file.")] = None,
    seed: Annotated[int | None, typer.Option("--seed", help="Seed of all random numbers.")] = None,
    hw: Annotated[str | None, typer.Option("--hw", help="Which hardware: fake, panda or fr3.")] = None,
    grasp_force_N: Annotated[
        float, typer.Option("--grasp-force", min=5.0, max=70.0, help="Grasp force of the hand, N.")
    ] = 40.0,
    handle_mm: Annotated[
        float, typer.Option("--handle-mm", min=2.0, max=70.0, help="Width of the handle between the fingers, mm.")
    ] = 12.0,
    yes: Annotated[bool, typer.Option("--yes", "-y", help="Ask nothing; refused for a real arm.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object on stdout.")] = False,
) -> None:
    """Find the table's height and the tool's pose in the hand by touching slowly. Do this before the first scoop.

    Planning uses the result from then on. Nothing is stored unless all touches agree.

    Example: adaptsim touch-off --task scooping --world steep-mount --seed 0 --yes
    """
    from adaptsim_cli import config
    from adaptsim_cli.touch_off import conduct
    from adaptsim_cli.touch_off.parts import Grasp
    from adaptsim_cli.wiring import touch_off as wiring

    resolved = config.load({"task": task, "world": world, "seed": seed, "hw": hw})
    request = conduct.TouchOffRequest(Grasp(1e-3 * handle_mm, grasp_force_N), yes, as_json)
    conduct.touch_off(resolved, request, wiring.open_touch_rig, wiring.touch_offs)
