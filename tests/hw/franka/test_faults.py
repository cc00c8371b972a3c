"""The campaign of `benchmarks/faults.py` in short: no promise is broken, and its judge would see one that is."""

from __future__ import annotations

from pathlib import Path

import faults
import numpy as np
import pytest
from fault_hand import HAND_FAULTS, IGNORED, Fingers, one_hand
from fault_lab import drawn, one_motion
from fault_stop import one_stop
from fault_world import IN_MOTION, World, release
from kept import Kept

from adaptsim_cli.bench.devices import stop_check
from hw.franka import playback
from hw.franka.hand_stop import Stopped
from hw.watchdog import Watchdog

SEED = 11


def test_every_kind_has_a_name_of_its_own_and_a_place_in_the_table() -> None:
    assert len(set(faults.KINDS)) == len(faults.KINDS)
    assert set(IN_MOTION) | set(HAND_FAULTS) | set(faults.CAMERAS) | set(faults.SESSIONS) <= set(faults.KINDS)


@pytest.mark.parametrize("kind", HAND_FAULTS)
def test_the_fingers_stop_at_every_fault(kind: str) -> None:
    for number in range(3):
        outcome = one_hand(kind, np.random.default_rng([SEED, number]))
        assert outcome.effective
        assert outcome.wrong == []


def test_fingers_that_nobody_stops_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(SEED)
    with monkeypatch.context() as patch:
        patch.setattr(Watchdog, "stop_reason", lambda self: "")
        assert not one_hand("fingers: program hangs", rng).effective, "nobody listens, so nothing is said"
    monkeypatch.setattr(Fingers, "stop", lambda self: None)
    notes = one_hand("fingers: pedal released", rng).wrong
    assert any(note.startswith("the fingers moved for") for note in notes)


def test_a_player_that_brakes_too_late_or_too_hard_is_found(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def stopped(folder: str) -> list[str]:
        rng = np.random.default_rng(SEED)
        return one_motion(
            ("pedal: released",), lambda n: ((200, release),), "trial", "fr3", rng, tmp_path / folder
        ).wrong

    assert stopped("right") == []
    with monkeypatch.context() as patch:
        patch.setattr(playback.Playback, "_brake", lambda self, tick: setattr(self, "_last", tick))
        assert any("acceleration" in note or "velocity" in note for note in stopped("at once"))


@pytest.mark.parametrize("motion", ["trial", "calibration"])
def test_a_motion_is_long_enough_for_a_fault(motion: str) -> None:
    course = drawn(motion, "panda", np.random.default_rng(SEED))
    assert len(course.path.t_s) > 500
    assert World().fired == []


@pytest.mark.long
@pytest.mark.parametrize("kind", [*faults.KINDS, faults.PAIR])
def test_no_promise_is_broken(kind: str) -> None:
    made = [faults.one(kind, number, SEED) for number in (0, 1)]
    assert [note for one in made for note in one["wrong"]] == []


@pytest.mark.slow
def test_the_campaign_goes_on_and_counts_every_kind(tmp_path: Path) -> None:
    out = tmp_path / "faults.jsonl"
    for part in ("1/2", "2/2"):
        share = (int(part[0]), 2)
        assert list(faults.campaign(2, 2, SEED, Kept(out.with_suffix(f".{part[0]}")), share))
    rows = [Kept(out.with_suffix(f".{i}")) for i in (1, 2)]
    again = [list(faults.campaign(2, 2, SEED, kept, (i, 2))) for i, kept in enumerate(rows, start=1)]
    effective = [one.kind for part in again for one in part if one.effective]
    assert all(effective.count(kind) >= 2 for kind in faults.KINDS)


def test_a_stop_that_is_believed_without_its_widths_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Stopped, "is_certain", property(lambda self: True))
    notes = [note for number in range(3) for note in one_hand(IGNORED, np.random.default_rng([SEED, number])).wrong]
    assert "a hand that went on is said to have stopped" in notes


@pytest.mark.long
@pytest.mark.parametrize("number", range(2))
def test_a_stop_that_coasts_is_beyond_the_worst_case_on_either_joint(
    number: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    outcome = one_stop(number, np.random.default_rng([SEED, number]))
    assert outcome.effective
    assert outcome.wrong == []
    if number == 1:  # the flange stays where joint 7 turns it
        monkeypatch.setattr(stop_check, "travel_m", lambda q_rad, cell: 0.0)
        assert any("0 mm measured" in note for note in one_stop(number, np.random.default_rng(SEED)).wrong)
