"""Tracking on a photograph of a real table: whatever breaks it is flagged, or refused, before."""

from __future__ import annotations

import pytest
from composites import Effects, Room, judge, spoilt

LOOKS = "looks different from when it was found"


@pytest.fixture(scope="module")
def room() -> Room:
    return Room()


@pytest.mark.long
def test_a_piece_on_a_real_table_is_followed_without_a_flag(room: Room) -> None:
    found = judge(room, Effects())
    assert not found.broken
    assert found.worst_mm < 1.5
    assert not found.flags


@pytest.mark.long
@pytest.mark.parametrize(("name", "level"), [("red", 1.1), ("shadow", 0.25), ("noise", 4.0), ("gain", 1.6)])
def test_harmless_effects_are_neither_flagged_nor_wrong(room: Room, name: str, level: float) -> None:
    found = judge(room, spoilt(name, level))
    assert not found.broken
    assert not found.flags


@pytest.mark.long
@pytest.mark.parametrize(("name", "level"), [("shine", 0.6)])
def test_what_breaks_tracking_is_flagged(room: Room, name: str, level: float) -> None:
    found = judge(room, spoilt(name, level))
    assert found.broken
    assert any(LOOKS in flag for flag in found.flags)


@pytest.mark.long
@pytest.mark.parametrize(("name", "level"), [("red", 1.5), ("blur_px", 24.0), ("shine", 0.35), ("gain", 0.05)])
def test_or_the_piece_is_refused(room: Room, name: str, level: float) -> None:
    assert judge(room, spoilt(name, level)).failed
