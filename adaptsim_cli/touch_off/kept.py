"""The touch-offs of one rig and task as a person lists, reads and compares them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from adaptsim_cli.errors import SessionError
from adaptsim_cli.screen import views
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.storage.numbered import remark, restored_from
from adaptsim_cli.touch_off.store import SavedTouchOff, TouchOffStore

HEAD = ("touch-off", "made", "table", "tool higher", "pitch", "")

VALUES = (
    ("table_height_m", "table height", 1e3, "mm"),
    ("tool_height_m", "tool sits higher by", 1e3, "mm"),
    ("tool_forward_m", "tool sits forward by", 1e3, "mm"),
    ("tool_pitch_rad", "tool pitch", float(np.rad2deg(1.0)), "°"),
    ("tool_roll_rad", "tool roll", float(np.rad2deg(1.0)), "°"),
)
"""Field, name for a person, factor to its unit."""


def listed(store: TouchOffStore) -> list[dict[str, Any]]:
    """One a touch-off, oldest first; the last one is in use. A damaged one comes with its error."""
    paths = store.numbered.all()
    return [_one(store, path, in_use=path == paths[-1]) for path in paths]


def rows(found: list[dict[str, Any]]) -> list[tuple[str, ...]]:
    """What `HEAD` names."""
    return [
        (one["name"], "", "", "", "", one["error"])
        if "error" in one
        else (
            one["name"],
            str(one["created"])[:16].replace("T", " "),
            f"{one['table_height']:+.2f} mm",
            f"{one['tool_height']:+.2f} mm",
            f"{one['tool_pitch']:+.2f}°",
            remark(one["in_use"], one["restored_from"]),
        )
        for one in found
    ]


def compared(store: TouchOffStore, first: str, second: str) -> list[tuple[str, str, str, str]]:
    """(quantity, first, second, second - first with the 95 % half width of the difference)."""
    a, b = (store.read(store.numbered.named(name)) for name in (first, second))
    body = []
    for key, name, scale, unit in VALUES:
        was, now = getattr(a, key), getattr(b, key)
        within = float(np.hypot(was.within, now.within))
        apart = f"{scale * (now.value - was.value):+.2f} ± {scale * within:.2f} {unit}"
        body.append((name, f"{scale * was.value:+.2f} {unit}", f"{scale * now.value:+.2f} {unit}", apart))
    return body


def values(known: SavedTouchOff) -> list[tuple[str, str, str]]:
    """(quantity, value, 95 % half width) of one touch-off."""
    return [
        (name, f"{scale * getattr(known, key).value:+.2f} {unit}", f"± {scale * getattr(known, key).within:.2f} {unit}")
        for key, name, scale, unit in VALUES
    ]


def tell(screen: Screen, store: TouchOffStore, found: list[dict[str, Any]], resting: Sequence[str]) -> None:
    """The list on the screen, with the sessions that rest on the one in use."""
    if found:
        screen.show(views.rows(HEAD, rows(found)))
    else:
        screen.plain(f"No touch-offs yet in {store.folder}")
    if resting:
        screen.show(f"Open sessions that rest on the one in use: {', '.join(resting)}")
    if len(found) > 1:
        names = f"{found[-2]['name']} {found[-1]['name']}"
        screen.next((f"adaptsim touch-off compare {names}", "with the same --task, --world or --hw"))
    else:
        screen.next(("adaptsim touch-off", "makes one, with the same --task, --world or --hw"))


def _one(store: TouchOffStore, path: Path, *, in_use: bool) -> dict[str, Any]:
    try:
        known: SavedTouchOff = store.read(path)
    except SessionError as error:
        return {"name": path.name, "error": str(error)}
    values = {key.rpartition("_")[0]: round(scale * getattr(known, key).value, 4) for key, _, scale, _ in VALUES}
    return {
        "name": path.name,
        "created": known.created,
        **values,
        "touches": len(known.touches),
        "in_use": in_use,
        "restored_from": restored_from(path),
    }
