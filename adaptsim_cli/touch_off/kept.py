"""Lists, shows and compares the touch-offs of one rig and task."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from adaptsim_cli.storage.numbered import remark
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


def row(one: dict[str, Any]) -> tuple[str, ...]:
    """The columns of `HEAD`."""
    return (
        one["name"],
        str(one["created"])[:16].replace("T", " "),
        f"{one['table_height_mm']:+.2f} mm",
        f"{one['tool_height_mm']:+.2f} mm",
        f"{one['tool_pitch_deg']:+.2f}°",
        remark(one["in_use"], one["restored_from"]),
    )


def compared(store: TouchOffStore, first: str, second: str) -> dict[str, Any]:
    """Every quantity of both, and second minus first with the 95 % half width of the difference, for JSON."""
    paths = [store.numbered.named(name) for name in (first, second)]
    a, b = map(store.read, paths)
    found = []
    for key, name, scale, unit in VALUES:
        was, now = getattr(a, key), getattr(b, key)
        found.append(
            {
                "quantity": name,
                "unit": unit,
                "first": scale * was.value,
                "second": scale * now.value,
                "difference": scale * (now.value - was.value),
                "within_95": scale * float(np.hypot(was.within, now.within)),
            }
        )
    return {"first": paths[0].name, "second": paths[1].name, "quantities": found}


def differences(found: dict[str, Any]) -> list[tuple[str, str, str, str]]:
    """(quantity, first, second, difference) of a comparison, for a person."""
    return [
        (
            q["quantity"],
            f"{q['first']:+.2f} {q['unit']}",
            f"{q['second']:+.2f} {q['unit']}",
            f"{q['difference']:+.2f} ± {q['within_95']:.2f} {q['unit']}",
        )
        for q in found["quantities"]
    ]


def values(known: SavedTouchOff) -> list[tuple[str, str, str]]:
    """(quantity, value, 95 % half width) of one touch-off."""
    return [
        (name, f"{scale * getattr(known, key).value:+.2f} {unit}", f"± {scale * getattr(known, key).within:.2f} {unit}")
        for key, name, scale, unit in VALUES
    ]


def told(known: SavedTouchOff, path: Path) -> dict[str, Any]:
    """What a list says of one, for JSON."""
    values = {
        f"{key.rpartition('_')[0]}_{'deg' if unit == '°' else unit}": round(scale * getattr(known, key).value, 4)
        for key, _, scale, unit in VALUES
    }
    return {"created": known.created, **values, "touches": len(known.touches)}
