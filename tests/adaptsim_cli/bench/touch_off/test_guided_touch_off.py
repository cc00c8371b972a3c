"""A touch-off by hand: where it finds the edge, what it asks again, and whom it is offered to."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest
from cells import cell
from fr3_process import RELAXED, Fr3Process
from players import InstantArm
from real_lab import quiet, said
from touch_rig import CELL, CREATED, HARDWARE, PITCH_RAD, PLACES, TASK, TOUCHED, Guided, plain, shown, world

from adaptsim_cli.bench.touch_off import guiding
from adaptsim_cli.bench.touch_off.parts import Grasp, GuidedTouchRig, HoldingHand, TouchOffFailed
from adaptsim_cli.bench.touch_off.store import SavedTouchOff
from adaptsim_cli.errors import StoppedByOperator
from adaptsim_cli.screen.console import Screen
from hw.errors import DeviceUnavailable
from hw.franka.arm import franka
from hw.franka.settings import FrankaSettings
from hw.grasping import FakeHand
from hw.ports import Hand
from hw.types import ArmState, Array
from hw.workcell import arm_model
from sim.lab.simulated import READY_RAD
from sim.lab.touch import TouchLab, true_X_FT
from sim.lab.world import World
from sim.panda.setting_down import TABLE


def rig_of(arm: object, person: object = None, model: str = "panda", hand: Hand | None = None) -> GuidedTouchRig:
    return GuidedTouchRig(
        name="fake",
        title="lab",
        key="test",
        tool_name="scooping tool",
        arm=arm,  # type: ignore[arg-type]
        model=arm_model(model, np.zeros(7)),
        designed=HARDWARE.X_FT,
        table=CELL.table,
        set_downs=PLACES,
        work_m=np.array(TOUCHED.centre_m),
        pause=lambda _: None,
        holding=None if hand is None else HoldingHand(hand, Grasp(TOUCHED.held_m)),
        person=person,  # type: ignore[arg-type]
    )


def edge_error_m(saved: SavedTouchOff, of: World) -> float:
    """How much higher the true edge is over the true table than planned, held as in a scoop."""
    c = saved.correction()
    middle = np.append((PLACES[0].corners[0].p_T_m + PLACES[0].corners[1].p_T_m) / 2.0, 1.0)
    pitch_rad = np.deg2rad(6.0)
    R = np.array([[np.cos(pitch_rad), 0, np.sin(pitch_rad)], [0, 1, 0], [-np.sin(pitch_rad), 0, np.cos(pitch_rad)]])
    X_WT = np.eye(4)
    X_WT[:3, :3] = R
    X_WT[:3, 3] = np.array([*TOUCHED.centre_m, PLACES[0].corners[0].radius_m]) - R @ middle[:3]
    X_BF = c.table.X_BW @ X_WT @ np.linalg.inv(c.X_FT(HARDWARE.X_FT))
    true_m = (X_BF @ true_X_FT(of, HARDWARE.X_FT) @ middle)[:3]
    return float(true_m[2] - PLACES[0].corners[0].radius_m - of.mount.true.table.height_at(true_m))


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_seven_set_downs_find_the_edge_and_the_pitch(seed: int) -> None:
    of = world()
    with TouchLab(TASK, of, seed, CELL, home_q_rad=READY_RAD) as lab:
        hand = None if seed else lab.hand
        saved = guiding.touch_off(rig_of(lab.arm, lab, hand=hand), quiet(), unattended=True, created=CREATED)
    assert abs(edge_error_m(saved, of)) < 1e-3
    assert saved.tool_pitch_rad.value == pytest.approx(PITCH_RAD, abs=0.03)
    assert saved.tool_roll_rad.value == pytest.approx(1e-3 * of.mount.tool_roll_mrad, abs=0.012)
    assert 0.0 < saved.edge_too_high_m < saved.edge_over_table_m
    assert lab.hand.commands == ([] if seed else ["home", "move", "grasp"])
    assert len({touch.place for touch in saved.touches}) == TABLE + 2 * len(PLACES)


def by_hand(
    monkeypatch: pytest.MonkeyPatch, steps: Callable[[list[Array]], list[tuple[str, Array | None]]]
) -> tuple[SavedTouchOff, Screen]:
    screen, postures = quiet(), shown(world())
    with InstantArm(READY_RAD, CELL) as arm:
        Guided(monkeypatch, arm, steps(postures))
        return guiding.touch_off(rig_of(arm), screen, unattended=False, created=CREATED), screen


def test_a_place_that_is_shown_again_replaces_the_one_before(monkeypatch: pytest.MonkeyPatch) -> None:
    whole, _ = by_hand(monkeypatch, plain)
    again, screen = by_hand(monkeypatch, lambda q: [("", q[0]), ("", q[0]), ("b", None), *[("", one) for one in q[1:]]])
    assert again.touches == whole.touches
    assert "Place 2 of 7: the edge on the table, the handle a little up (about 10°), about 56 cm ahead" in said(screen)
    assert said(screen).count("Place 2 of 7") == 2


def test_a_tool_that_is_held_otherwise_is_asked_for_again(monkeypatch: pytest.MonkeyPatch) -> None:
    whole, _ = by_hand(monkeypatch, plain)
    again, screen = by_hand(monkeypatch, lambda q: [("", q[-1]), *plain(q)])
    assert again.touches == whole.touches
    assert "again: the tool is held at -1" in said(screen)
    assert "this place needs +2° to +18°" in said(screen)


def test_what_does_not_fit_is_not_stored(monkeypatch: pytest.MonkeyPatch) -> None:
    """At the third place a 4 mm thick thing lies under the edge."""

    def on_a_thing(postures: list[Array]) -> list[tuple[str, Array | None]]:
        higher = replace(world(), mount=replace(world().mount, table_height_mm=world().mount.table_height_mm + 4.0))
        return plain([*postures[:2], shown(higher)[2], *postures[3:]])

    with pytest.raises(TouchOffFailed, match=r"not accepted: .*off the plane of the other places"):
        by_hand(monkeypatch, on_a_thing)


def test_q_stops_and_nothing_is_stored(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(StoppedByOperator, match="a touch-off that is in use stays in use"):
        by_hand(monkeypatch, lambda q: [("", q[0]), ("q", None)])


@pytest.mark.parametrize(
    ("width_m", "holds", "said_then"),
    [
        (TOUCHED.held_m, True, ""),
        (TOUCHED.held_m - 0.0015, True, r"moved by -1\.5 mm \(at most 1\)"),
        (0.0, False, "no longer"),
    ],
)
def test_a_tool_that_slips_while_it_is_set_down_is_noticed(
    width_m: float, holds: bool, said_then: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    hand = FakeHand(TOUCHED.held_m, holds=True)

    def slip() -> str:
        hand.width_m, hand.holds = width_m, holds
        return guided()

    with InstantArm(READY_RAD, CELL) as arm, hand:
        guided = Guided(monkeypatch, arm, plain(shown(world()))).answer
        monkeypatch.setattr("adaptsim_cli.screen.console.read_line", slip)
        ends = pytest.raises(TouchOffFailed, match=said_then) if said_then else nullcontext()
        with ends:
            guiding.touch_off(rig_of(arm, hand=hand), quiet(), unattended=False, created=CREATED)
    assert hand.commands == [], "it held the tool before, so it does not move"


def test_a_hand_whose_connection_ended_with_the_guiding_is_asked_again(monkeypatch: pytest.MonkeyPatch) -> None:
    hand = FakeHand(TOUCHED.held_m, holds=True)

    def lose() -> str:
        hand.__exit__()
        return guided()

    with InstantArm(READY_RAD, CELL) as arm, hand:
        guided = Guided(monkeypatch, arm, plain(shown(world()))).answer
        monkeypatch.setattr("adaptsim_cli.screen.console.read_line", lose)
        assert guiding.touch_off(rig_of(arm, hand=hand), quiet(), unattended=False, created=CREATED).touches


def test_a_tool_that_nobody_offers_is_not_grasped() -> None:
    class Absent:
        def offer_tool(self, present: bool) -> None: ...

    hand = FakeHand()
    with hand, pytest.raises(TouchOffFailed, match="does not hold the tool"):
        guiding.touch_off(rig_of(None, Absent(), hand=hand), quiet(), unattended=True, created=CREATED)
    assert hand.commands == ["home", "move"]


class Dropping:
    """An arm whose controller drops the connection before the state of that number."""

    def __init__(self, arm: object, drop: Callable[[], object], at: int) -> None:
        self._arm, self._drop, self._at, self.states = arm, drop, at, 0

    @property
    def model(self) -> str:
        return "fr3"

    def state(self) -> ArmState:
        self.states += 1
        if self.states == self._at:
            self._drop()
            with pytest.raises(DeviceUnavailable):
                for _ in range(10_000):  # states that were under way still arrive
                    self._arm.state()  # type: ignore[attr-defined]
        return self._arm.state()  # type: ignore[attr-defined]


def over_the_network(server: Fr3Process, monkeypatch: pytest.MonkeyPatch, drop_at: int) -> tuple[SavedTouchOff, int]:
    """A touch-off by hand of the simulated controller, which drops the connection before one state."""
    screen, postures = quiet(), iter(shown(world(), model="fr3"))

    def answer() -> str:
        if "activate FCI. Done" in said(screen)[-160:]:
            server.tell("fci on")
        else:
            server.place(next(postures))
        return "\n"

    monkeypatch.setattr("adaptsim_cli.screen.console.read_line", answer)
    with franka(cell("fr3"), FrankaSettings(server.host), RELAXED) as arm:
        dropping = Dropping(arm, lambda: server.tell("fci off"), drop_at)
        saved = guiding.touch_off(rig_of(dropping, model="fr3"), screen, unattended=False, created=CREATED)
    assert ("switch the fr3 to Execution" in said(screen)) == (drop_at > 0)
    assert ("The places shown so far are kept." in said(screen)) == (drop_at > 0)
    return saved, dropping.states


@pytest.mark.slow
def test_a_controller_that_drops_the_connection_at_any_moment_costs_one_question(
    server: Fr3Process, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole, states = over_the_network(server, monkeypatch, 0)
    assert states >= 3 * len(PLACES)
    for at in range(1, states + 1):
        saved, _ = over_the_network(server, monkeypatch, at)
        for one, other in zip(saved.touches, whole.touches, strict=True):
            assert one.place == other.place
            np.testing.assert_allclose(one.q_rad, other.q_rad, atol=1e-3)
