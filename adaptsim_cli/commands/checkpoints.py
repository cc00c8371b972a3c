"""`adaptsim checkpoints list/verify`."""

from __future__ import annotations

from typing import Annotated

import typer

app = typer.Typer(help="The pretrained policies.", no_args_is_help=True)

_Json = Annotated[bool, typer.Option("--json", help="JSON on stdout.")]


@app.command("list")
def list_checkpoints(as_json: _Json = False) -> None:
    """Shipped checkpoints and those of `adaptsim pretrain`.

    Example: adaptsim checkpoints list
    """
    from adaptsim_cli import config, console, views, wiring

    found = wiring.list_checkpoints(config.load())
    screen = console.Screen(as_json=as_json)
    if as_json:
        screen.data(found)
    else:
        body = [(c["task"], c["name"], c["created"], c["folder"]) for c in found]
        screen.show(views.rows(("task", "name", "created", "folder"), body))


@app.command()
def verify(
    checkpoint: Annotated[str, typer.Argument(help="Folder of the checkpoint; empty: the shipped one.")] = "",
    task: Annotated[str | None, typer.Option("--task", help="Which task it is for.")] = None,
    as_json: _Json = False,
) -> None:
    """Read every file of a checkpoint and check it against its card. Exit code 8 when it is corrupt or foreign.

    Example: adaptsim checkpoints verify --task scooping
    """
    from adaptsim_cli import config, console, wiring

    card = wiring.verify_checkpoint(config.load({"task": task, "checkpoint": checkpoint or None}).config)
    screen = console.Screen(as_json=as_json)
    if as_json:
        screen.data(card)
    else:
        screen.plain(f"{card['folder']} is intact: task {card['task']}, sha256 {card['sha256'][:12]}")
