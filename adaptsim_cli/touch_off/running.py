"""From the command line to a running touch-off, and from its result to the screen."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

from adaptsim_cli.config import Config, Places, Resolved
from adaptsim_cli.errors import DiskFull, Interrupted, StoppedByOperator, UsageError
from adaptsim_cli.screen import console
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.storage.durable import versions
from adaptsim_cli.touch_off import flow, terminal_views
from adaptsim_cli.touch_off.asking import NEVER_CONFIRMS, HumanAssistant, NoAssistant
from adaptsim_cli.touch_off.errors import TouchOffFailed
from adaptsim_cli.touch_off.parts import Grasp, TouchRig
from adaptsim_cli.touch_off.store import SavedTouchOff, TouchOffStore, record
from hw.errors import HandError, HardwareError

OpenRig = Callable[[Config, Places, Grasp], AbstractContextManager[TouchRig]]
Stores = Callable[[Config, Places], TouchOffStore]
"""(settings) -> the touch-offs of the rig."""


@dataclass(frozen=True)
class TouchOffRequest:
    """The operator's options on the command line."""

    grasp: Grasp
    yes: bool
    as_json: bool


Ends = Callable[[Config, Places], Sequence[str]]
"""Settings -> the open sessions that use the present calibration and touch-off."""


def nothing_ends(config: Config, places: Places) -> tuple[str, ...]:
    """`Ends` without sessions."""
    return ()


def touch_off(
    resolved: Resolved,
    request: TouchOffRequest,
    open_rig: OpenRig,
    stores: Stores,
    ends: Ends = nothing_ends,
    screen: Screen | None = None,
) -> None:
    """The whole touch-off. Raises the error that stops it, with the command to continue."""
    config, screen = resolved.config, screen or Screen(as_json=request.as_json)
    if not config.is_simulated and request.yes:
        raise UsageError(NEVER_CONFIRMS)
    if not request.yes:
        console.require_terminal()
    operator = NoAssistant() if request.yes else HumanAssistant(screen)
    store = stores(config, resolved.places)
    screen.resting("table and tool as now known", ends(config, resolved.places))
    with _how_to_continue(), open_rig(config, resolved.places, request.grasp) as rig:
        screen.show(terminal_views.explanation(rig))
        found = flow.touch_off(rig, operator, screen)
        saved = record(found, rig, datetime.now(UTC).isoformat(timespec="seconds"), versions())
    folder = store.save(saved)
    screen.plain(f"In use from now on: {folder}")
    screen.next((f"adaptsim rollout {config.same_lab}", "one trial with it"))
    if request.as_json:
        screen.data("touch-off", summary(saved) | {"folder": str(folder)})


def summary(saved: SavedTouchOff) -> dict[str, Any]:
    """A touch-off for JSON: values in mm and degrees, each with its 95 % half width."""
    import numpy as np

    degrees = float(np.rad2deg(1.0))
    rows = (
        ("table_height_mm", saved.table_height_m, 1e3),
        ("table_tilt_x_mm_m", saved.tilt_x, 1e3),
        ("table_tilt_y_mm_m", saved.tilt_y, 1e3),
        ("tool_height_mm", saved.tool_height_m, 1e3),
        ("tool_forward_mm", saved.tool_forward_m, 1e3),
        ("tool_pitch_deg", saved.tool_pitch_rad, degrees),
        ("tool_roll_deg", saved.tool_roll_rad, degrees),
    )
    values = {name: {"value": scale * e.value, "within_95": scale * e.within} for name, e, scale in rows}
    return {
        **values,
        "edge_over_table_within_95_mm": 1e3 * saved.edge_over_table_m,
        "repeat_mm": 1e3 * saved.repeat_m,
        "misfit_mm": 1e3 * saved.misfit_m,
        "slip_mm": 1e3 * saved.slip_m,
        "touches": len(saved.touches),
        "sha256": saved.sha256(),
    }


@contextmanager
def _how_to_continue() -> Iterator[None]:
    hint = "Nothing was stored; the previous touch-off stays in use. Start again with: adaptsim touch-off"
    try:
        yield
    except KeyboardInterrupt as error:
        stopped = Interrupted("interrupted")
        stopped.add_note(hint)
        raise stopped from error
    except HandError as error:
        raise TouchOffFailed(f"{error}\n{hint}") from error
    except (TouchOffFailed, StoppedByOperator, DiskFull, HardwareError) as error:
        error.add_note(hint)
        raise
