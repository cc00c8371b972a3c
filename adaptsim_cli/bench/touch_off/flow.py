"""A touch-off from the empty hand to the stored correction. Read downwards: this is the order of events.

Every motion is planned and checked just before it begins. Every descent ends at the first force, or goes back.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from datetime import UTC, datetime

import numpy as np

from adaptsim_cli.bench.touch_off import terminal_views
from adaptsim_cli.bench.touch_off.parts import Grasp, GuidedTouchRig, TouchOffFailed, TouchRig
from adaptsim_cli.bench.touch_off.solving import DIFFER_M, Result, Touched, solve, table_of
from adaptsim_cli.bench.touch_off.store import SavedTouchOff, SlipCheckRecord, SlowTouchRecord, TouchOffStore
from adaptsim_cli.config import Config, Places, Resolved
from adaptsim_cli.errors import UsageError
from adaptsim_cli.screen import console
from adaptsim_cli.screen.console import Screen, how_to_continue
from adaptsim_cli.screen.reply import Reply
from adaptsim_cli.storage.durable import versions
from hw.collision import Table
from hw.contact import began
from hw.errors import HandError, NoContact
from hw.kinematics import forward
from hw.types import Array, Contact, Guard
from hw.workcell import ArmModel
from sim.panda.moves import free_path
from sim.panda.touching import HeldTool, Probe, Stage, descent, stance

ABOVE_M = 0.022
"""Every way down begins at this height over the expected table."""
FIRST_DEEPER_M, DEEPER_M = 0.016, 0.010
"""Depth below the expected table that the first way down searches, and that of all others."""
EARLY_M = 0.016
"""A touch this far above the expected table is not the table."""
FAST_M_S, SLOW_M_S = 0.015, 0.0025
BEFORE_M, BEYOND_M = 0.003, 0.007
"""A slow touch begins this far above the fast one's result, and gives up this far below it."""
TOUCH_N, PRESS_N = 4.0, 15.0
"""The force of a touch; and the task's largest force, for the slip check."""
PRESS_BEYOND_M = 0.015
"""How far below the table the slip check may be commanded: a flexible blade needs more."""
SLOW_TOUCHES = 2
SLIPPED_M = 0.0004
"""A larger movement of the tool in the hand is more than the measurement's own error."""
_OPEN_M = 0.06
_FIRST = "comes over the first place on the table"
NEVER_CONFIRMS = "--yes never confirms the motion of a real arm; run the command in a terminal, without --yes"


OpenRig = Callable[[Config, Places, Grasp], AbstractContextManager[TouchRig]]
"""Connects the devices."""
_HINT = "Nothing was stored; the previous touch-off stays in use. Start again with: adaptsim touch-off"
UNSEEN = (
    "the automatic touch-off has never run on a real arm, so it does not start by itself. Set the tool down by "
    "hand: add --guide. Or watch the automatic one, a hand on the stop button: add --automatic"
)


def run(
    resolved: Resolved,
    grasp: Grasp,
    store: TouchOffStore,
    sessions: Sequence[str],
    open_rig: OpenRig,
    screen: Screen,
    *,
    yes: bool,
) -> Reply:
    """The whole automatic touch-off. Raises the error that stops it, with the command to continue.

    `sessions` are the open ones that use the present touch-off.
    """
    config = resolved.config
    if not config.is_simulated and yes:
        raise UsageError(NEVER_CONFIRMS)
    if not yes:
        console.require_terminal()
    screen.resting("table and tool as now known", sessions)
    with how_to_continue(_HINT, "interrupted"), open_rig(config, resolved.places, grasp) as rig:
        screen.show(terminal_views.explanation(rig))
        saved = touch_off(rig, screen, unattended=yes, created=now())
    return conclude(saved, store, config, screen)


def now() -> str:
    """The time of a touch-off, ISO 8601."""
    return datetime.now(UTC).isoformat(timespec="seconds")


def conclude(saved: SavedTouchOff, store: TouchOffStore, config: Config, screen: Screen) -> Reply:
    """Store a touch-off, and name the next command."""
    folder = store.save(saved)
    screen.plain(f"In use from now on: {folder}")
    data = terminal_views.summary(saved) | {"folder": str(folder)}
    trial = (f"adaptsim rollout {config.same_lab}", "one trial with it")
    return Reply(data, next=[trial])


def touch_off(rig: TouchRig, screen: Screen, *, unattended: bool, created: str) -> SavedTouchOff:
    """Home the hand, touch the table, take the tool, touch with it, press, touch again, solve.

    No question is asked if `unattended`, in the simulated lab only. `created` is ISO 8601.
    Raises TouchOffFailed, HardwareError, NotExecutable, StoppedByOperator, UsageError.
    """

    def wait(question: str, does: str, then: str) -> None:
        if not unattended:
            screen.go_on(question, does, then=then, assurance="nothing was stored")

    if rig.is_real and unattended:
        raise UsageError(NEVER_CONFIRMS)
    rig.release.start()
    wait(
        f"Take the {rig.tool_name} out of the hand. Keep your own fingers away: the hand opens and closes next.",
        "when it is empty",
        "Nothing moves yet: the program asks before the hand opens and closes.",
    )
    rig.tool_there(False)
    rig.hand.home()
    rig.hand.move(0.0)
    rig.release.begin_run(_FIRST, "touches the table with its closed fingers at all places, slowly, and comes back")
    fingers = _touch_all(rig, rig.empty, rig.plan.table, rig.empty.cell.table, screen)
    table, _, _ = table_of(fingers)
    _go(rig, rig.home_rad, rig.empty)
    rig.release.end_run()
    take_tool(rig)
    all_places = f"touches the table with the {rig.tool_name} at all places, slowly, and comes back"
    rig.release.begin_run(_FIRST, all_places)
    tool = _touch_all(rig, rig.loaded, rig.plan.tool, table, screen)
    slip_m = _slip_m(rig, table, tool, screen)
    _go(rig, rig.home_rad, rig.loaded)
    rig.release.end_run()
    rig.release.completed()
    work_m = np.asarray(np.mean([probe.xy_m for probe in rig.plan.tool], axis=0))
    result, problems = solve(fingers, tool, rig.loaded.X_FT, work_m)
    slip = SlipCheckRecord(moved_m=slip_m, pressed_N=PRESS_N, grasp_force_N=rig.grasp.force_N)
    screen.show(terminal_views.result(result, slip))
    if abs(slip_m) > SLIPPED_M:
        raise TouchOffFailed(
            f"the tool slipped: pressed with {PRESS_N:.0f} N its corner moved by {1e3 * slip_m:+.1f} mm "
            f"(at most {1e3 * SLIPPED_M:.1f}). Grasp harder than {rig.grasp.force_N:g} N (--grasp-force), or roughen "
            "the handle, then run again"
        )
    if problems:
        raise TouchOffFailed("not accepted: " + "; ".join(problems))
    return stored(rig, result, (*fingers, *tool), rig.empty.cell.arm, created).model_copy(update={"slip": slip})


def stored(
    rig: TouchRig | GuidedTouchRig, result: Result, touches: Sequence[Touched], arm: ArmModel, created: str
) -> SavedTouchOff:
    """The record of a finished touch-off."""
    return SavedTouchOff(
        **dict(result),
        created=created,
        hw=rig.name,
        arm=arm.name,
        rig=rig.key,
        tool=rig.tool_name,
        source=f"touch-off on {rig.title}",
        joint_zeros_rad=tuple(float(q) for q in arm.zeros_rad),
        touches=tuple(
            SlowTouchRecord(place=touch.probe.name, q_rad=tuple(map(float, touch.q_rad))) for touch in touches
        ),
        versions=versions(),
    )


def _touch_all(rig: TouchRig, bench: HeldTool, probes: Sequence[Probe], table: Table, screen: Screen) -> list[Touched]:
    """Touch at each place: down to the table, then again slowly. The result of one place helps to find the next."""
    touches: list[Touched] = []
    lower_m = 0.0  # by how much the last place was lower than expected
    for number, probe in enumerate(probes):
        deeper_m = FIRST_DEEPER_M if number == 0 else DEEPER_M
        expected = Table(table.height_m + lower_m, table.slope_x, table.slope_y)
        here = _at(rig, bench, probe, expected, deeper_m)
        guard = bench.guard(probe.feeler, TOUCH_N)
        fast = _feel(rig, bench, probe, here, (Stage(ABOVE_M + deeper_m, FAST_M_S),), deeper_m, guard)
        heights = [_above(bench, bench.cell.arm.true_rad(fast.q_rad), probe, expected)]
        if heights[0] > EARLY_M:
            raise TouchOffFailed(
                f"{probe.name}: touched {1e3 * heights[0]:.0f} mm above where the table should be. Clear away anything "
                "that lies there and run again"
            )
        slow = [_slowly(rig, bench, probe, here, heights[0]) for _ in range(SLOW_TOUCHES)]
        heights = [_above(bench, q, probe, expected) for q in slow]
        if (differ_m := max(heights) - min(heights)) > DIFFER_M:
            raise TouchOffFailed(
                f"{probe.name}: {len(heights)} touches differ by {1e3 * differ_m:.2f} mm "
                f"(at most {1e3 * DIFFER_M:.1f}): the table is soft, or the tool is loose. Fix it and run again"
            )
        lower_m += float(np.mean(heights)) if number == 0 else 0.0
        touches += [Touched(probe, q) for q in slow]
        screen.show(terminal_views.touched(number + 1, len(probes), probe.name, heights))
    return touches


def _slip_m(rig: TouchRig, table: Table, tool: Sequence[Touched], screen: Screen) -> float:
    """Press the first corner onto the table with the task's force, and touch again: how far has it moved?"""
    probe = rig.plan.tool[0]
    before = [_above(rig.loaded, t.q_rad, probe, table) for t in tool if t.probe is probe]
    expected = Table(table.height_m + float(np.mean(before)), table.slope_x, table.slope_y)
    here = _at(rig, rig.loaded, probe, expected, DEEPER_M)
    screen.show(f"  Slip check: pressing with {PRESS_N:.0f} N, then touching again")
    stages = _last_slow(0.0, PRESS_BEYOND_M)
    _feel(rig, rig.loaded, probe, here, stages, PRESS_BEYOND_M, rig.loaded.guard(probe.feeler, PRESS_N))
    again = [_slowly(rig, rig.loaded, probe, here, 0.0) for _ in range(SLOW_TOUCHES)]
    after = [_above(rig.loaded, q, probe, table) for q in again]
    return float(np.mean(after) - np.mean(before))


def _at(rig: TouchRig, bench: HeldTool, probe: Probe, expected: Table, deeper_m: float) -> Array:
    """Move over the place; return the reported posture (7,) there."""
    search = (Stage(ABOVE_M + deeper_m, FAST_M_S),)
    q_rad = stance(probe, bench, expected, ABOVE_M, search, TOUCH_N, rig.arm.state().q_rad)
    _go(rig, q_rad, bench)
    return q_rad


def _slowly(rig: TouchRig, bench: HeldTool, probe: Probe, here: Array, found_m: float) -> Array:
    """Down again, slowly at the end; return the true joints (7,) at the start of the touch, before anything bent."""
    guard = bench.guard(probe.feeler, TOUCH_N)
    contact = _feel(rig, bench, probe, here, _last_slow(found_m, BEYOND_M), BEYOND_M - found_m, guard)
    touch = began(contact, guard)
    if touch is None:
        raise TouchOffFailed(
            f"{probe.name}: the force did not rise as on a table ({contact.force_N:.0f} N after {contact.t_s:.2f} s): "
            "the tool hit something else, or the surface is soft. Check both and run again"
        )
    return bench.cell.arm.true_rad(touch.q_rad)


def _last_slow(found_m: float, beyond_m: float) -> tuple[Stage, Stage]:
    """The motion from `ABOVE_M` fast to shortly before the found height, then slowly to `beyond_m` below it."""
    return Stage(ABOVE_M - found_m - BEFORE_M, FAST_M_S), Stage(BEFORE_M + beyond_m, SLOW_M_S)


def _feel(
    rig: TouchRig, bench: HeldTool, probe: Probe, here: Array, stages: tuple[Stage, ...], below_m: float, guard: Guard
) -> Contact:
    """Move down from `here` until it touches; the arm then returns to `here`."""
    path = descent(here, stages, guard, below_m, bench.cell.arm)
    try:
        return rig.arm.execute_until_contact(path, guard)
    except NoContact as error:
        raise TouchOffFailed(
            f"{probe.name}: nothing was touched down to {1e3 * below_m:.0f} mm below where the table should be. Check "
            "that the table is there and the tool in the hand, and run again"
        ) from error


def take_tool(rig: TouchRig) -> None:
    """Let the operator put the tool between the fingers, and grasp it. Raises TouchOffFailed, HandError."""
    rig.hand.move(_OPEN_M)
    rig.release.one(
        f"Hold the {rig.tool_name} between the fingers, as its drawing shows. Keep your own fingers clear: "
        f"the hand closes with {rig.grasp.force_N:g} N.",
        f"The hand closes on the {rig.tool_name}.",
        "nothing was stored",
    )
    rig.tool_there(True)
    try:
        rig.hand.grasp(rig.grasp.width_m, rig.grasp.force_N)
    except HandError as error:
        raise TouchOffFailed(f"the hand does not hold the tool: {error}") from error
    if not rig.hand.state().holds:
        raise TouchOffFailed("the hand reports that it holds nothing; hand the tool over again and run again")


def _go(rig: TouchRig, q_rad: Array, bench: HeldTool) -> None:
    here = rig.arm.state().q_rad
    if np.abs(here - q_rad).max() > 1e-4:
        rig.arm.execute(free_path(here, q_rad, bench.cell))


def _above(bench: HeldTool, q_rad: Array, probe: Probe, table: Table) -> float:
    """Height of the corner over `table`, for the tool as designed."""
    X_BT = forward(q_rad) @ bench.X_FT
    p_m = X_BT[:3, :3] @ probe.feeler.p_T_m + X_BT[:3, 3]
    return float(p_m[2] - probe.feeler.radius_m - table.height_at(p_m))
