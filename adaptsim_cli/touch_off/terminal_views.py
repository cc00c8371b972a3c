"""Everything that a touch-off prints for an operator, as rich renderables."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.text import Text

from adaptsim_cli.screen import views
from adaptsim_cli.touch_off.parts import TouchRig
from adaptsim_cli.touch_off.solving import MeasuredValue, Result


def explanation(rig: TouchRig) -> RenderableType:
    """The announcement of the touch-off."""
    lines = (
        "Finds how high the table is and how the tool sits in the hand, by touching. About five minutes.",
        f"1  The hand is homed, empty; its closed fingers touch the table at {len(rig.plan.table)} places.",
        f"2  You hand it the {rig.tool_name}; its corners touch the table, held in {len(rig.plan.tool)} ways.",
        "3  It presses once as hard as the task will, and touches again: has it slipped?",
        "The arm comes down at 15 mm/s at most, stops at the first 4 N and goes back up. Keep the table empty.",
    )
    return Group(
        views.badge(rig.name, rig.title),
        Text("Touch-off", style="bold"),
        *(Padding(Text(line), (0, 0, 0, 2)) for line in lines),
    )


def touched(number: int, of: int, name: str, heights_m: Sequence[float]) -> RenderableType:
    """One line for one place."""
    seen = ", ".join(f"{1e3 * h:+.2f}" for h in heights_m)
    return Text.assemble((f"  {number:2d} of {of}", "bold"), f"  {name}: {seen} mm from the expected height")


def pressing(force_N: float) -> RenderableType:
    """The line before the tool is pressed on the table."""
    return Text(f"  Slip check: pressing with {force_N:.0f} N, then touching again")


def result(found: Result, slipped_m: float, pressed_N: float) -> RenderableType:
    """The results with their intervals."""
    rows = [
        _row("table height under the work area", found.table_height_m, 1e3, "mm"),
        _row("table rises along X", found.tilt_x, 1e3, "mm/m"),
        _row("table rises along Y", found.tilt_y, 1e3, "mm/m"),
        _row("tool sits higher by", found.height_m, 1e3, "mm"),
        _row("tool sits forward by", found.forward_m, 1e3, "mm"),
        _row("tool pitch (edge down)", found.pitch_rad, float(np.rad2deg(1.0)), "°"),
        _row("tool roll (left side up)", found.roll_rad, float(np.rad2deg(1.0)), "°"),
        ("edge against table", "", f"± {1e3 * found.edge_over_table_m:.2f} mm"),
        ("repeats differ by (one sigma)", "", f"{1e3 * found.repeat_m:.2f} mm"),
        (f"moved when pressed with {pressed_N:.0f} N", f"{1e3 * slipped_m:+.2f} mm", ""),
    ]
    return Group(Text(""), views.rows(("quantity", "value", "95 % within"), rows))


def _row(name: str, found: MeasuredValue, scale: float, unit: str) -> tuple[str, str, str]:
    return name, f"{scale * found.value:+.2f} {unit}", f"± {scale * found.within:.2f} {unit}"
