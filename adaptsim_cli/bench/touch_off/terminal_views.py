"""Everything that a touch-off shows: before and while it runs, as JSON, and beside others that are kept."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.text import Text

from adaptsim_cli.bench.touch_off.parts import GuidedTouchRig
from adaptsim_cli.bench.touch_off.solving import Result
from adaptsim_cli.bench.touch_off.store import SavedTouchOff
from adaptsim_cli.screen import views

_DEG = float(np.rad2deg(1.0))
LISTED = (
    ("table_height_m", "table_height_mm", "table height under the work area", 1e3, "mm"),
    ("tool_height_m", "tool_height_mm", "tool sits higher by", 1e3, "mm"),
    ("tool_forward_m", "tool_forward_mm", "tool sits forward by", 1e3, "mm"),
    ("tool_pitch_rad", "tool_pitch_deg", "tool pitch (edge down)", _DEG, "°"),
    ("tool_roll_rad", "tool_roll_deg", "tool roll (left side up)", _DEG, "°"),
)
QUANTITIES = (
    LISTED[0],
    ("tilt_x", "table_tilt_x_mm_m", "table rises along X", 1e3, "mm/m"),
    ("tilt_y", "table_tilt_y_mm_m", "table rises along Y", 1e3, "mm/m"),
    *LISTED[1:],
)
"""Field, name in JSON, name for a person, factor to its unit, unit."""

COLUMNS = ("table", "tool higher", "pitch")
"""The columns of a list, besides name, time and remark."""


def explanation(rig: GuidedTouchRig) -> RenderableType:
    """The announcement of a touch-off by hand."""
    lines = (
        "Finds how high the table is and how the tool sits, by setting it down. About three minutes; the "
        "arm never moves by itself.",
        f"Guide the arm so that the {rig.tool_name} stands on the table at {len(rig.set_downs)} places, both corners "
        "touching, and let go each time.",
        "It may stand lightly: a corner in the air is an error, a pressed one bends the blade. Keep the table empty.",
    )
    return Group(
        views.badge(rig.name, rig.title),
        Text("Touch-off", style="bold"),
        *(Padding(Text(line), (0, 0, 0, 2)) for line in lines),
    )


def set_down(number: int, of: int, name: str, height_m: float, pitch_rad: float) -> RenderableType:
    """One line for one set-down."""
    return Text.assemble(
        (f"  {number} of {of}", "bold"),
        f"  {name}: {1e3 * height_m:+.1f} mm from the expected height, held at {_DEG * pitch_rad:+.0f}°",
    )


def result(fit: Result | SavedTouchOff) -> RenderableType:
    """The results with their intervals."""
    values = [(words, getattr(fit, field), factor, unit) for field, _, words, factor, unit in QUANTITIES]
    rows = [
        *((words, f"{k * v.value:+.2f} {unit}", f"± {k * v.within:.2f} {unit}") for words, v, k, unit in values),
        ("edge against table", "", f"± {1e3 * fit.edge_over_table_m:.2f} mm"),
        ("largest misfit of a place", "", f"{1e3 * fit.misfit_m:.2f} mm"),
    ]
    too_high = f"The edge may be up to {1e3 * fit.edge_too_high_m:.2f} mm higher than assumed (one-sided 95 %)."
    return Group(Text(""), views.rows(("quantity", "value", "95 % within"), rows), Text(too_high))


def summary(saved: SavedTouchOff) -> dict[str, Any]:
    """A touch-off for JSON: values in mm and degrees, each with its 95 % half width."""
    values = {name: (getattr(saved, field), factor) for field, name, _, factor, _ in QUANTITIES}
    return {
        **{name: {"value": k * e.value, "within_95": k * e.within} for name, (e, k) in values.items()},
        "edge_over_table_within_95_mm": 1e3 * saved.edge_over_table_m,
        "edge_too_high_95_mm": 1e3 * saved.edge_too_high_m,
        "misfit_mm": 1e3 * saved.misfit_m,
        "touches": len(saved.touches),
        "sha256": saved.sha256(),
    }


def description(record: SavedTouchOff, path: Path) -> Sequence[RenderableType]:
    """One touch-off, and when it was made."""
    return f"{path.name}, made {record.created}, with {record.tool}", result(record)


def listing_row(record: SavedTouchOff, path: Path) -> dict[str, Any]:
    """The row of one in a list, for JSON."""
    values = {name: round(factor * getattr(record, field).value, 4) for field, name, _, factor, _ in LISTED}
    return {**values, "touches": len(record.touches)}


def columns(one: dict[str, Any]) -> tuple[str, ...]:
    """The values of `COLUMNS`."""
    return (
        f"{one['table_height_mm']:+.2f} mm",
        f"{one['tool_height_mm']:+.2f} mm",
        f"{one['tool_pitch_deg']:+.2f}°",
    )


def compared(a: SavedTouchOff, b: SavedTouchOff) -> dict[str, Any]:
    """Every quantity of both, and second minus first with the 95 % half width of the difference, for JSON."""
    pairs = [(words, getattr(a, field), getattr(b, field), k, unit) for field, _, words, k, unit in LISTED]
    quantities = [
        {
            "quantity": words,
            "unit": unit,
            "first": k * was.value,
            "second": k * now.value,
            "difference": k * (now.value - was.value),
            "within_95": k * float(np.hypot(was.within, now.within)),
        }
        for words, was, now, k, unit in pairs
    ]
    return {"quantities": quantities}


def comparison(difference: dict[str, Any]) -> RenderableType:
    """A comparison for a person."""
    rows = [
        (
            q["quantity"],
            f"{q['first']:+.2f} {q['unit']}",
            f"{q['second']:+.2f} {q['unit']}",
            f"{q['difference']:+.2f} ± {q['within_95']:.2f} {q['unit']}",
        )
        for q in difference["quantities"]
    ]
    return views.rows(("quantity", "first", "second", "difference"), rows, right=(1, 2, 3))
