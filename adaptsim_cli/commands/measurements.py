"""`list`, `show`, `restore` and `compare` for a rig's numbered calibrations and touch-offs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

import typer

from adaptsim_cli.commands.command import command
from adaptsim_cli.screen.reply import Reply, Step

if TYPE_CHECKING:
    from rich.console import RenderableType

    from adaptsim_cli.config import Resolved
    from adaptsim_cli.screen.console import Screen
    from adaptsim_cli.storage.numbered import NumberedRecords

Name = Annotated[str, typer.Argument(help="Name or number, as `list` shows it.")]

RIG = ("task", "world", "seed", "hw")
"""The settings that name a rig or a simulated world."""


@dataclass(frozen=True)
class MeasurementKind:
    """One kind of measurement: its words, and how it is read and shown (also as JSON)."""

    command: str  # "calibrate"
    noun: str  # "calibration"
    example: str  # options that name a rig
    then: Step  # the command after a restoration, and its reason
    store: Callable[[Resolved], NumberedRecords[Any]]  # of the rig of these settings
    views: Callable[[], Any]  # the module `terminal_views` of the kind: COLUMNS, columns, told, summary, show, ...


def add_to(app: typer.Typer, kind: MeasurementKind) -> None:
    """Add the four commands to the group of `kind`."""
    noun, called = kind.noun, f"adaptsim {kind.command}"

    def again(name: str, resolved: Resolved, why: str) -> Step:
        return f"{called} restore {name} {resolved.config.same_lab}", why

    @app.command(
        "list",
        help=f"List the {noun}s of a rig or world, oldest first, and the sessions that rest on the one in use."
        f"\n\nExample: {called} list {kind.example}",
    )
    @command(*RIG)
    def list_all(resolved: Resolved) -> Reply:
        from adaptsim_cli.session import rig_sessions

        return _listed(kind, kind.store(resolved), rig_sessions.open_sessions(resolved.config, resolved.places))

    @app.command(
        "show",
        help=f"Show one {noun}: every value and check.\n\nExample: {called} show 1 {kind.example}",
    )
    @command(*RIG)
    def show(resolved: Resolved, name: Name) -> Reply:
        store, views = kind.store(resolved), kind.views()
        path = store.numbered.named(name)
        record = store.read(path)
        data = views.summary(record) | {"folder": str(path)}
        return Reply(data, views.description(record, path), [again(path.name, resolved, "puts it in use again")])

    @app.command(
        "restore",
        help=f"Put an earlier {noun} in use again, as a copy with the next number. Nothing is deleted.\n\n"
        "Names the open sessions that rest on the one in use until now."
        f"\n\nExample: {called} restore 1 {kind.example}",
    )
    @command(*RIG)
    def restore(screen: Screen, resolved: Resolved, name: Name) -> Reply:
        from datetime import UTC, datetime

        from adaptsim_cli.session import rig_sessions
        from adaptsim_cli.storage.durable import locked

        store = kind.store(resolved)
        source = store.numbered.named(name)
        screen.resting(f"the {noun} in use", rig_sessions.open_sessions(resolved.config, resolved.places))
        with locked(store.folder, f"another command uses the {noun}s of this rig: wait until it has ended"):
            path = store.numbered.restore(name, datetime.now(UTC).isoformat(timespec="seconds"))
        data = {"in_use": path.name, "restored_from": source.name, "folder": str(path)}
        after, why = kind.then
        return Reply(data, [f"In use from now on: {path}"], [(f"{after} {resolved.config.same_lab}", why)])

    @app.command(
        "compare",
        help=f"Say how two {noun}s differ, beside how well both are known.\n\n"
        f"Example: {called} compare 1 2 {kind.example}",
    )
    @command(*RIG)
    def compare(resolved: Resolved, first: Name, second: Name) -> Reply:
        store, views = kind.store(resolved), kind.views()
        paths = [store.numbered.named(name) for name in (first, second)]
        names = {"first": paths[0].name, "second": paths[1].name}
        data = names | views.compared(*map(store.read, paths))
        return Reply(data, [views.comparison(data)], [again(paths[0].name, resolved, "puts the first in use again")])


def _listed(kind: MeasurementKind, store: NumberedRecords[Any], sessions: Sequence[str]) -> Reply:
    """All, oldest first, with the open `sessions` that use the current one, and the next command."""
    from adaptsim_cli.screen import views
    from adaptsim_cli.storage.numbered import remark

    kinds = kind.views()
    entries = store.listed(lambda record, path: {"created": record.created} | kinds.listing_row(record, path))

    def row(one: dict[str, Any]) -> tuple[str, ...]:
        if "error" in one:
            return one["name"], *("",) * (1 + len(kinds.COLUMNS)), one["error"]
        return (
            one["name"],
            one["created"][:16].replace("T", " "),
            *kinds.columns(one),
            remark(one["in_use"], one["restored_from"]),
        )

    listed = f"{kind.noun.replace('-', '_')}s"
    data = {"rig": store.folder.name, listed: entries, "open_sessions": list(sessions)}
    text: list[RenderableType] = [f"No {kind.noun}s yet in {store.folder}"]
    if entries:
        text = [views.rows((kind.noun, "made", *kinds.COLUMNS, ""), [row(one) for one in entries])]
    if sessions:
        text.append(f"Open sessions that use the current one: {', '.join(sessions)}")
    called = f"adaptsim {kind.command}"
    step = (called, "makes one, with the same --task, --world or --hw")
    if len(entries) > 1:
        names = f"{entries[-2]['name']} {entries[-1]['name']}"
        step = (f"{called} compare {names}", "with the same --task, --world or --hw")
    return Reply(data, text, [step])
