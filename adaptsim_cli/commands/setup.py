"""`adaptsim setup`."""

from __future__ import annotations

from typing import Annotated

import typer

from adaptsim_cli import options


def setup(
    task: options.Task = None,
    world: options.World = None,
    seed: options.Seed = None,
    hw: Annotated[str | None, typer.Option("--hw", help="Which hardware: fr3, panda, or fake to practise.")] = None,
    begin: Annotated[str, typer.Option("--from", help="Do this step and all after it again, e.g. camera.")] = "",
    operator: options.Operator = None,
    speak: options.Speak = False,
    yes: options.Yes = False,
) -> None:
    """Set up a lab: from an unpacked arm to the first trial, with a check after every step.

    It asks, writes the rig file, and leads through calibration, touch-off and the first motions. A walk that was
    stopped goes on where it was. In the simulated lab it is practised, with a rig file of its own, practice.toml.

    Example: adaptsim setup --hw fr3 --task scooping
    """
    from adaptsim_cli.screen.console import Screen
    from adaptsim_cli.setup import walk
    from adaptsim_cli.setup.answers import begun
    from adaptsim_cli.wiring import settings

    resolved = settings.load({"task": task, "world": world, "seed": seed, "hw": hw, "operator": operator})
    answers = begun(resolved, Screen(leads=False), yes=yes)
    walk.walk(answers, begin=begin)
    lab = answers.config.same_lab
    Screen().next(
        (f"adaptsim run-iteration {lab}", "the first session"), (f"adaptsim doctor {lab}", "everything in one table")
    )
