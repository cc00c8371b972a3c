"""A touch-off by hand: a person sets the tool down at seven places; the program reads the joints at rest.

Nothing moves by itself and no force is felt. It serves a tool that is screwed on, and everybody who does not want a
motion that searches for the table.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager

import numpy as np

from adaptsim_cli.bench.touch_off import terminal_views
from adaptsim_cli.bench.touch_off.flow import conclude, now, stored
from adaptsim_cli.bench.touch_off.parts import GuidedTouchRig, TouchOffFailed
from adaptsim_cli.bench.touch_off.solving import Touched, solve
from adaptsim_cli.bench.touch_off.store import SavedTouchOff, TouchOffStore
from adaptsim_cli.config import Config, Places, Resolved
from adaptsim_cli.errors import StoppedByOperator
from adaptsim_cli.screen import console
from adaptsim_cli.screen.console import Screen, how_to_continue
from adaptsim_cli.screen.guided import GuidedArm, NotAtRest, at_rest
from adaptsim_cli.screen.keys import Key, enter, stop
from adaptsim_cli.screen.reply import Reply
from hw.kinematics import forward
from hw.types import Array
from sim.panda.setting_down import TABLE, SetDown, middle, pitch_rad
from sim.panda.touching import Probe

FAR_M = 0.05
"""An end of the tool that seems farther from the expected table is not set down, or the rig file is of another lab."""
TRIES = 20
"""How often one place is asked for before the command gives up; also the simulated lab must not ask for ever."""
_KEPT = "Nothing was stored; the previous touch-off stays in use."
_HINT = f"{_KEPT} Start again with: adaptsim touch-off --guide"
_SHARED = (
    "Set down by its edge, the tool cannot tell its own height from the table's: only the sum is measured, and that is "
    "the edge over the table."
)
_SHOWN = "The places shown so far are kept."

OpenGuidedRig = Callable[[Config, Places], AbstractContextManager[GuidedTouchRig]]
"""Connects the arm."""


def run(
    resolved: Resolved,
    store: TouchOffStore,
    sessions: Sequence[str],
    open_rig: OpenGuidedRig,
    screen: Screen,
    *,
    yes: bool,
) -> Reply:
    """The whole touch-off by hand. Raises the error that stops it, with the command to continue.

    `sessions` are the open ones that use the present touch-off.
    """
    config = resolved.config
    unattended = config.unattended(yes)
    if not unattended:
        console.require_terminal()
    screen.resting("table and tool as now known", sessions)
    with how_to_continue(_HINT, "interrupted"), open_rig(config, resolved.places) as rig:
        screen.show(terminal_views.guided_explanation(rig))
        saved = touch_off(rig, screen, unattended=unattended, created=now())
        screen.plain("Guide the arm up now: the tool must be clear of the table before anything moves.")
    return conclude(saved, store, config, screen)


def touch_off(rig: GuidedTouchRig, screen: Screen, *, unattended: bool, created: str) -> SavedTouchOff:
    """Have the tool set down at every place, and solve. `created` is ISO 8601; `unattended`: the lab's own person does
    it, and nobody is asked.

    Raises TouchOffFailed, HardwareError, StoppedByOperator.
    """
    asking = _Asking(rig, screen, unattended)
    shown_rad = asking.all()
    fingers, tool = touches_of(rig.set_downs, shown_rad, rig.designed)
    result, problems = solve(fingers, tool, rig.designed, rig.work_m, together=2)
    screen.show(terminal_views.result(result, None))
    screen.plain(_SHARED)
    if problems:
        raise TouchOffFailed("not accepted: " + "; ".join(problems))
    return stored(rig, result, (*fingers, *tool), rig.model, created)


def touches_of(
    set_downs: Sequence[SetDown], true_rad: Sequence[Array], designed: Array
) -> tuple[list[Touched], list[Touched]]:
    """The inputs of `solve` for fingers and for the tool, from the true joints (7,) of every set-down.

    The table is measured by the middle of the edge, where the tool is assumed to be; the tool by both corners
    everywhere.
    """
    pairs = list(zip(set_downs, true_rad, strict=True))
    unused = np.eye(3)  # the solution needs no planned orientation
    fingers = [Touched(Probe(one.name, middle(one.corners, designed), one.xy_m, unused), q) for one, q in pairs[:TABLE]]
    tool = [
        Touched(Probe(f"{corner.name}, {one.name}", corner, one.xy_m, unused), q)
        for one, q in pairs
        for corner in one.corners
    ]
    return fingers, tool


class _Asking:
    """The set-downs of a person, or of the lab in place of a person."""

    def __init__(self, rig: GuidedTouchRig, screen: Screen, unattended: bool) -> None:
        self._rig, self._screen, self._unattended = rig, screen, unattended
        self._arm = GuidedArm(rig.arm, screen, _SHOWN)

    def all(self) -> list[Array]:
        """(7,) true joints of every set-down; a person may go back by one."""
        shown: list[Array] = []
        while len(shown) < len(self._rig.set_downs):
            q_rad = self._one(len(shown))
            shown = [*shown, q_rad] if q_rad is not None else shown[:-1]
        return shown

    def _one(self, number: int) -> Array | None:
        """(7,) true joints of one set-down; None: the one before is shown again. Raises TouchOffFailed."""
        where, of = self._rig.set_downs[number], len(self._rig.set_downs)
        for _ in range(TRIES):
            if not self._done(where, number, of):
                return None
            if self._rig.person is not None:
                self._rig.person.set_down(where, number)
            try:
                q_rad = self._rig.model.true_rad(at_rest(self._arm, self._rig.pause).q_rad)
            except NotAtRest as error:
                self._screen.note(f"  again: {error}")
                continue
            height_m, held_rad = _held(where, q_rad, self._rig)
            if (problem := _problem(where, height_m, held_rad)) is None:
                self._screen.show(terminal_views.set_down(number + 1, of, where.name, height_m, held_rad))
                return q_rad
            self._screen.note(f"  again: {problem}")
        raise TouchOffFailed(f"{where.name}: {TRIES} tries did not succeed: {_KEPT}")

    def _done(self, where: SetDown, number: int, of: int) -> bool:
        """Whether the person has set it down: Enter is yes, b goes back. Raises StoppedByOperator at q."""
        if self._unattended:
            return True
        x_m, y_m = where.xy_m
        side = "the middle" if abs(y_m) < 0.02 else f"{abs(100 * y_m):.0f} cm to the {'left' if y_m > 0 else 'right'}"
        question = (
            f"Place {number + 1} of {of}: {where.how} (about {np.rad2deg(abs(where.pitch_rad)):.0f}°), about "
            f"{100 * x_m:.0f} cm ahead of the base, {side}. Let go. At rest?"
        )
        read = enter("to read the joints", "The program waits until the arm rests and reads its joints. Nothing moves.")
        back = (Key("b", "to go back", "The place before is shown again."),) if number else ()
        answer = self._screen.choose(question, read, *back, stop(f"The command ends. {_KEPT}"))
        if answer == "q":
            raise StoppedByOperator(f"stopped by the operator. {_KEPT}")
        return answer == ""


def _held(where: SetDown, q_rad: Array, rig: GuidedTouchRig) -> tuple[float, float]:
    """Height of the end's middle over the table, and the tool's pitch, both as assumed until now."""
    X_WT = np.linalg.inv(rig.table.X_BW) @ forward(q_rad) @ rig.designed
    p_T_m = (where.corners[0].p_T_m + where.corners[1].p_T_m) / 2.0
    height_m = float((X_WT[:3, :3] @ p_T_m + X_WT[:3, 3])[2]) - where.corners[0].radius_m
    return height_m, pitch_rad(X_WT[:3, :3])


def _problem(where: SetDown, height_m: float, held_rad: float) -> str | None:
    """Why a set-down does not count, or None."""
    low, high = np.rad2deg(where.pitches_rad)
    held_deg = np.rad2deg(held_rad)
    if not low <= held_deg <= high:
        return (
            f"the tool is held at {held_deg:+.0f}° (edge down is positive), this place needs {low:+.0f}° to "
            f"{high:+.0f}°: {where.how}"
        )
    if abs(height_m) > FAR_M:
        return (
            f"it seems {1e3 * height_m:+.0f} mm off the expected table (at most {1e3 * FAR_M:.0f}): set it down on the "
            "table, or correct [table] and the tool's pose in the rig file"
        )
    return None
