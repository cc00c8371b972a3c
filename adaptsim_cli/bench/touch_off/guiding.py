"""A touch-off by hand: a person sets the tool down at seven places; the program reads the joints at rest.

The arm never moves by itself and no force is felt. Only a hand that does not hold the tool yet closes on it before.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from datetime import UTC, datetime

import numpy as np

from adaptsim_cli.bench.touch_off import terminal_views
from adaptsim_cli.bench.touch_off.parts import Grasp, GuidedTouchRig, HoldingHand, TouchOffFailed
from adaptsim_cli.bench.touch_off.solving import Touched, solve
from adaptsim_cli.bench.touch_off.store import SavedTouchOff, SetDownRecord, TouchOffStore
from adaptsim_cli.config import Config, Places, Resolved
from adaptsim_cli.errors import StoppedByOperator
from adaptsim_cli.screen import console
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.screen.continuing import how_to_continue
from adaptsim_cli.screen.guided import GuidedArm, NotAtRest, at_rest
from adaptsim_cli.screen.keys import Key, enter, stop
from adaptsim_cli.screen.release import grasping
from adaptsim_cli.screen.reply import Reply
from adaptsim_cli.storage.durable import versions
from hw.errors import DeviceUnavailable, HandError
from hw.grasping import SLIPPED_M, WIDEST_M
from hw.kinematics import forward
from hw.types import Array
from sim.panda.setting_down import TABLE, SetDown, middle, pitch_rad

FAR_M = 0.05
"""If an end of the tool seems farther than this from the expected table, it is not set down, or the rig file is of
another lab."""
TRIES = 20
"""How often one place is asked for before the command gives up; also the simulated lab must not ask for ever."""
_KEPT = "Nothing was stored; a touch-off that is in use stays in use."
_SHARED = (
    "Set down by its edge, the tool cannot tell its own height from the table's: only the sum is measured, and that is "
    "the edge over the table."
)
_OPEN_M = 0.75 * WIDEST_M
_SHOWN = "The places shown so far are kept."

OpenGuidedRig = Callable[[Config, Places, Grasp], AbstractContextManager[GuidedTouchRig]]
"""Connects arm and hand."""


def run(
    resolved: Resolved,
    grasp: Grasp,
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
    hint = f"{_KEPT} Start again with: adaptsim touch-off {config.same_lab}"
    with how_to_continue(hint, "interrupted"), open_rig(config, resolved.places, grasp) as rig:
        screen.show(terminal_views.explanation(rig))
        saved = touch_off(rig, screen, unattended=unattended, created=datetime.now(UTC).isoformat(timespec="seconds"))
        screen.plain("Guide the arm up now: the tool must be clear of the table before anything moves.")
    folder = store.save(saved)
    screen.plain(f"In use from now on: {folder}")
    trial = (f"adaptsim rollout {config.same_lab}", "one trial with it")
    return Reply(terminal_views.summary(saved) | {"folder": str(folder)}, next=[trial])


def touch_off(rig: GuidedTouchRig, screen: Screen, *, unattended: bool, created: str) -> SavedTouchOff:
    """Have the tool held and set down at every place, then solve. `created` is ISO 8601. If `unattended`, the lab's
    stand-in does it, and nobody is asked.

    Raises TouchOffFailed, HardwareError, StoppedByOperator.
    """
    width_m = 0.0 if rig.holding is None else take_tool(rig, rig.holding, screen, unattended=unattended)
    shown_rad = _Asking(rig, screen, unattended).all()
    if rig.holding is not None:
        require_held(rig.holding, width_m)
    edge, tool = touches_of(rig.set_downs, shown_rad, rig.designed)
    result, problems = solve(edge, tool, rig.designed, rig.work_m)
    screen.show(terminal_views.result(result))
    screen.plain(_SHARED)
    if problems:
        raise TouchOffFailed("not accepted: " + "; ".join(problems))
    return SavedTouchOff(
        **dict(result),
        created=created,
        hw=rig.name,
        arm=rig.model.name,
        rig=rig.key,
        tool=rig.tool_name,
        source=f"touch-off on {rig.title}",
        joint_zeros_rad=tuple(rig.model.zeros_rad.tolist()),
        touches=tuple(SetDownRecord(place=one.name, q_rad=tuple(map(float, one.q_rad))) for one in (*edge, *tool)),
        versions=versions(),
    )


def take_tool(rig: GuidedTouchRig, holding: HoldingHand, screen: Screen, *, unattended: bool) -> float:
    """The width (m) between the fingers that hold the tool; a hand that holds nothing gets it first.

    Raises TouchOffFailed, HandError, StoppedByOperator.
    """

    def person(present: bool) -> None:
        if rig.person is not None:
            rig.person.offer_tool(present)

    hand, grasp = holding.hand, holding.grasp
    if not hand.state().holds:
        if not hand.state().homed:
            if not unattended:
                screen.go_on(
                    f"Take the {rig.tool_name} out of the hand. Keep your own fingers away: the hand opens and closes "
                    "next.",
                    "when it is empty",
                    then="Nothing moves yet: the program asks before the hand opens and closes.",
                    assurance=_KEPT,
                )
            person(False)
            hand.home()
        hand.move(_OPEN_M)
        holding.release.one(
            f"Hold the {rig.tool_name} between the fingers, as its drawing shows. Keep your own fingers clear: the "
            f"hand closes with {grasp.force_N:g} N.",
            grasping(grasp.width_m, grasp.force_N),
            f"The hand closes on the {rig.tool_name}.",
            "nothing was stored",
        )
        person(True)
        try:
            hand.grasp(grasp.width_m, grasp.force_N)
        except HandError as error:
            raise TouchOffFailed(f"the hand does not hold the tool: {error}") from error
    state = hand.state()
    if not state.holds:
        raise TouchOffFailed("the hand reports that it holds nothing; hand the tool over again and run again")
    screen.show(f"  The hand holds the {rig.tool_name}; its fingers are {1e3 * state.width_m:.1f} mm apart.")
    return state.width_m


def require_held(holding: HoldingHand, width_m: float) -> None:
    """Raises TouchOffFailed unless the hand still holds the tool, with its fingers `width_m` apart as before."""
    try:
        state = holding.hand.state()
    except DeviceUnavailable:  # guiding the arm may have ended the hand's connection too
        holding.hand.__enter__()
        state = holding.hand.state()
    moved_m = state.width_m - width_m
    if not state.holds or abs(moved_m) > SLIPPED_M:
        raise TouchOffFailed(
            f"the tool is no longer held as before: its fingers have moved by {1e3 * moved_m:+.1f} mm (at most "
            f"{1e3 * SLIPPED_M:g}). Grasp harder than {holding.grasp.force_N:g} N (--grasp-force), or roughen the "
            f"handle, and run again. {_KEPT}"
        )


def touches_of(
    set_downs: Sequence[SetDown], true_rad: Sequence[Array], designed: Array
) -> tuple[list[Touched], list[Touched]]:
    """The inputs of `solve` for edge and tool, from the true joints (7,) of every set-down."""
    pairs = list(zip(set_downs, true_rad, strict=True))
    edge = [Touched(one.name, middle(one.corners, designed), q_rad) for one, q_rad in pairs[:TABLE]]
    tool = [Touched(f"{corner.name}, {one.name}", corner, q_rad) for one, q_rad in pairs for corner in one.corners]
    return edge, tool


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
        """(7,) true joints of one set-down; None if the one before is to be repeated. Raises TouchOffFailed."""
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
