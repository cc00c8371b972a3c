"""A touch-off by hand: where it finds the edge, what it asks again, and whom it is offered to."""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cells import cell
from fr3_process import RELAXED, Fr3Process
from real_lab import RIG, ToyDevices, calibrated, quiet, said, typing, waivers, write_rig
from touch_rig import HARDWARE, PITCH_RAD, TASK, world

from adaptsim_cli import config
from adaptsim_cli.bench.touch_off import guiding
from adaptsim_cli.bench.touch_off.parts import GuidedTouchRig, TouchOffFailed
from adaptsim_cli.bench.touch_off.store import SavedTouchOff
from adaptsim_cli.bench.touch_off_in_use import open_guided_rig, touch_offs
from adaptsim_cli.commands import app
from adaptsim_cli.config import Resolved
from adaptsim_cli.errors import StoppedByOperator
from adaptsim_cli.screen.console import Screen
from hw.errors import DeviceUnavailable
from hw.fake import FakeArm, FakeClock
from hw.franka.arm import franka
from hw.franka.settings import FrankaSettings
from hw.types import ArmState, Array
from hw.workcell import arm_model
from sim.lab.setting_down import set_down_q_rad, true_X_FT
from sim.lab.simulated import READY_RAD
from sim.lab.touch import TouchLab
from sim.lab.world import World
from sim.panda.setting_down import TABLE, set_downs
from sim.panda.tool import cell_as_shipped, feeling, touchable

TOUCHED = touchable(HARDWARE)
PLACES = set_downs(TOUCHED.feelers, TOUCHED.centre_m)
CELL = cell_as_shipped(HARDWARE, "panda").holding(feeling(HARDWARE))
CREATED = "2026-01-01T00:00:00+00:00"


def shown(of: World, seed: int = 0, model: str = "panda") -> list[Array]:
    """(7,) joints of every set-down in a world."""
    rng, q_rad, at = np.random.default_rng(seed), READY_RAD, arm_model(model, np.zeros(7))
    found = []
    for place in PLACES:
        q_rad = set_down_q_rad(place, of, HARDWARE.X_FT, at, q_rad, rng)
        found.append(q_rad)
    return found


def rig_of(arm: object, person: object = None, model: str = "panda", name: str = "fake") -> GuidedTouchRig:
    return GuidedTouchRig(
        name=name,
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
        saved = guiding.touch_off(rig_of(lab.arm, lab), quiet(), unattended=True, created=CREATED)
    assert abs(edge_error_m(saved, of)) < 1e-3
    assert saved.tool_pitch_rad.value == pytest.approx(PITCH_RAD, abs=0.03)
    assert saved.tool_roll_rad.value == pytest.approx(1e-3 * of.mount.tool_roll_mrad, abs=0.012)
    assert 0.0 < saved.edge_too_high_m < saved.edge_over_table_m
    assert saved.slip is None
    assert len({touch.place for touch in saved.touches}) == TABLE + 2 * len(PLACES)


class Guided:
    """A person at the terminal: each Enter comes with the next posture; another answer leaves the arm where it is."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, arm: FakeArm, steps: list[tuple[str, Array | None]]) -> None:
        self._arm, self._steps = arm, iter(steps)
        monkeypatch.setattr("sys.stdin", self)
        monkeypatch.setattr("adaptsim_cli.screen.console.read_line", self.answer)

    def answer(self) -> str:
        typed, q_rad = next(self._steps)
        if q_rad is not None:
            self._arm._q_rad = np.array(q_rad)
        return f"{typed}\n"


def by_hand(
    monkeypatch: pytest.MonkeyPatch, steps: Callable[[list[Array]], list[tuple[str, Array | None]]]
) -> tuple[SavedTouchOff, Screen]:
    screen, postures = quiet(), shown(world())
    with FakeArm(READY_RAD, FakeClock(), CELL) as arm:
        Guided(monkeypatch, arm, steps(postures))
        return guiding.touch_off(rig_of(arm), screen, unattended=False, created=CREATED), screen


def plain(postures: list[Array]) -> list[tuple[str, Array | None]]:
    return [("", q) for q in postures]


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
    with pytest.raises(StoppedByOperator, match="the previous touch-off stays in use"):
        by_hand(monkeypatch, lambda q: [("", q[0]), ("q", None)])


SCREWED = RIG + waivers("hand")


def resolved(place: Path, text: str) -> Resolved:
    write_rig(place, text)
    return config.load({"hw": "panda", "task": "scooping"})


@pytest.mark.usefixtures("kim")
@pytest.mark.parametrize("text", [RIG, SCREWED], ids=["held", "screwed on"])
def test_a_real_lab_connects_the_arm_alone_and_moves_nothing(
    place: Path, monkeypatch: pytest.MonkeyPatch, text: str
) -> None:
    there, devices, screen = resolved(place, text), ToyDevices(), quiet()
    calibrated(there)
    with open_guided_rig(there.config, there.places, devices.drivers(), screen) as rig:
        assert devices.arm is not None
        quick, postures = replace(rig, pause=lambda _: None), shown(world())
        Guided(monkeypatch, devices.arm, plain(postures))
        saved = guiding.touch_off(quick, screen, unattended=False, created=CREATED)
        assert devices.arm.executed == []
    assert "hand" not in devices.opened
    assert saved.hw == "panda"
    assert saved.tool == "scooping tool"
    touch_offs(there.config, there.places).save(saved)


@pytest.mark.usefixtures("kim")
def test_on_a_real_arm_the_automatic_one_waits_for_its_flag_and_proposes_the_hand(
    place: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    calibrated(resolved(place, RIG))
    devices = ToyDevices()
    monkeypatch.setattr("adaptsim_cli.bench.devices.lab.makers_drivers", devices.drivers)
    assert app.run(["touch-off", "--hw", "panda"]) == 2
    said_then = " ".join(capfd.readouterr().err.split())
    assert "the automatic touch-off has never run on a real arm" in said_then
    assert "add --guide" in said_then
    assert "add --automatic" in said_then
    assert app.run(["touch-off", "--hw", "panda", "--guide", "--automatic"]) == 2
    assert "exclude each other" in capfd.readouterr().err
    assert devices.opened == {}
    monkeypatch.setattr("sys.stdin", io.StringIO("q\n"))
    monkeypatch.setattr("adaptsim_cli.screen.console.require_terminal", lambda *said: None)
    assert app.run(["touch-off", "--hw", "panda", "--guide"]) == 7
    assert "arm" in devices.opened
    typing(monkeypatch, "q")
    assert app.run(["touch-off", "--hw", "panda", "--automatic"]) == 7
    assert "hand" in devices.opened


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
