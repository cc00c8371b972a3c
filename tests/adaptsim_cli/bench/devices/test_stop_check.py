"""The stop button, measured in a slow swing: on the stand-in of an arm that needs its time to come to rest."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cells import READY, cell, joint
from fault_world import user_stop
from living_sdk import LivingSdk
from players import arm_of
from real_lab import quiet, said, typing

from adaptsim_cli import config
from adaptsim_cli.bench.devices.known_arm import KnownArm, StopMeasurement, folder_of
from adaptsim_cli.bench.devices.opening import open_lab
from adaptsim_cli.bench.devices.stop_check import StopCheck, swing
from adaptsim_cli.bench.motion import mounted_for
from adaptsim_cli.errors import StoppedByOperator
from adaptsim_cli.screen.release import Release
from hw.collision import KeepOut
from hw.errors import ArmFault, MotionRefused
from hw.stopping import REDUCED_M_S, speeds_m_s
from sim.tasks import get_task

CELL = cell("fr3")


class PressedAt:
    """The stop button, pressed in the n-th cycle of the motions together."""

    def __init__(self, sdk: LivingSdk, cycle: int) -> None:
        self.sdk, self.left = sdk, cycle

    def __call__(self, cycle: int) -> None:
        self.left -= 1
        if self.left == 0:
            user_stop(self)  # type: ignore[arg-type]


class Released(io.StringIO):
    """The operator's answers; the button is released before the last two, which are about that."""

    def __init__(self, sdk: LivingSdk, answers: tuple[str, ...]) -> None:
        super().__init__("".join(f"{answer}\n" for answer in answers))
        self.sdk, self.left = sdk, len(answers)

    def readline(self, *args: Any) -> str:  # type: ignore[override]
        self.left -= 1
        if self.left == 0:
            self.sdk.modes.pressed = False
        return super().readline(*args)


def measured(folder: Path, cycle: int, monkeypatch: pytest.MonkeyPatch, *answers: str) -> tuple[StopMeasurement, str]:
    sdk = LivingSdk(k=False, q_rad=READY.tolist())
    sdk.when = PressedAt(sdk, cycle)
    monkeypatch.setattr("sys.stdin", Released(sdk, answers))
    screen, known = quiet(), KnownArm(folder)
    with arm_of(sdk, "fr3") as arm:
        release = Release(screen, "fr3", True)
        found = StopCheck(screen, arm, arm, CELL, known, release).measure(lambda: "Kim")
        assert arm.state().fault is None
    assert known.read().stop == found
    return found, said(screen)


def test_a_swing_is_slow_allowed_and_ends_where_it_began() -> None:
    path = swing(READY, CELL)
    assert 0.24 < speeds_m_s(path, CELL).max() < REDUCED_M_S
    assert 8.0 < path.duration_s < 20.0
    np.testing.assert_allclose(path.q_rad[[0, -1]], [READY, READY], atol=1e-9)
    CELL.require(path, READY)


@pytest.mark.long
def test_a_joint_without_room_leaves_the_swing_to_the_next() -> None:
    beside = KeepOut("a wall", np.array([-1.0, 0.2, -0.1]), np.array([1.0, 1.0, 1.5]))
    path = swing(READY, cell("fr3", keep_out=(beside,)))
    assert np.abs(path.q_rad - READY)[:, 0].max() == 0.0
    assert np.abs(path.q_rad - READY)[:, 6].max() == pytest.approx(0.8, abs=1e-3)
    everywhere = KeepOut("a box", np.array([-1.0, -1.0, -0.4]), np.array([1.0, 1.0, 1.5]))
    with pytest.raises(MotionRefused, match="no joint has room"):
        swing(READY + joint(1, 0.1), cell("fr3", keep_out=(everywhere,)))


@pytest.mark.long
def test_time_and_way_until_rest_are_kept_and_compared(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found, text = measured(tmp_path, len(swing(READY, CELL).t_s) // 2, monkeypatch, "y", "recover", "recover")
    assert 0.03 < found.time_s < 0.4
    assert 0.001 < found.distance_m < 0.03
    assert found.is_within
    assert found.worst_distance_m < 0.12
    assert "within the worst case of" in str(found)
    assert "will swing to and fro" in text
    kept = json.loads((tmp_path / "known.json").read_text())
    assert kept["stop"]["by"] == "Kim"


@pytest.mark.long
def test_nobody_pressed_and_it_is_asked_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cycles = len(swing(READY, CELL).t_s)
    _, text = measured(tmp_path, cycles + 3000, monkeypatch, "y", "y", "recover")
    assert "the stop button was not pressed" in text


def test_enter_lets_nothing_swing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(StoppedByOperator):
        measured(tmp_path, 4000, monkeypatch, "", "", "q")
    assert KnownArm(tmp_path).read().stop is None


@pytest.mark.long
def test_a_reflex_is_no_stop_button(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sdk = LivingSdk(k=False, q_rad=READY.tolist())

    def reflex(cycle: int) -> None:
        sdk.modes.reasons = ("joint_reflex",) if cycle == 3000 else sdk.modes.reasons

    sdk.when = reflex
    typing(monkeypatch, "y")
    screen = quiet()
    with arm_of(sdk, "fr3") as arm, pytest.raises(ArmFault, match="joint_reflex"):
        StopCheck(screen, arm, arm, CELL, KnownArm(tmp_path), Release(screen, "fr3", True)).measure(lambda: "Kim")
    assert KnownArm(tmp_path).read().stop is None


def test_a_stop_beyond_the_worst_case_says_so() -> None:
    late = StopMeasurement("2026-03-01T08:00:00+00:00", "Kim", 0.6, 0.02, 0.47, 0.1)
    assert not late.is_within
    assert "0.60 s and 20 mm, BEYOND the worst case of 0.47 s and 100 mm (2026-03-01, Kim)" in str(late)


@pytest.mark.long
def test_in_the_simulated_lab_a_stand_in_presses(place: Path) -> None:
    task, resolved = get_task("pushing"), config.load({"task": "pushing", "seed": 3})
    with open_lab(resolved.config, task) as lab:
        found = lab.measure_stop(mounted_for(resolved, None))
        assert KnownArm(folder_of(resolved.places, lab.rig)).read().stop == found
    assert found.by == "a stand-in"
    assert found.is_within
    assert 0.0 < found.distance_m < 0.05
