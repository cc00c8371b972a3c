"""The bottle with the noise and the missing readings of a real Kinect: followed, flagged or refused."""

from __future__ import annotations

import re

import pytest
from composites_bottle import Effects, Room, judge, spoilt


@pytest.fixture(scope="module")
def room() -> Room:
    return Room()


@pytest.mark.long
def test_a_bottle_with_the_holes_of_a_printed_mug_is_one_bottle_and_followed(room: Room) -> None:
    assert 0.3 < room.holes.mean() < 0.4
    found = judge(room, Effects())
    assert not found.failed
    assert found.worst_mm < 1.5
    assert not found.flags


@pytest.mark.long
@pytest.mark.parametrize(("name", "level"), [("noise", 4.0), ("ring_px", 10), ("flying_px", 2), ("scale", 1.005)])
def test_harmless_effects_are_neither_flagged_nor_wrong(room: Room, name: str, level: float) -> None:
    found = judge(room, spoilt(name, level))
    assert not found.broken
    assert not found.flags


@pytest.mark.parametrize(
    ("name", "level", "said"),
    [
        ("missing", 2, "reads only .* of the bottle .* matt tape"),
        ("thin", 0.3, "reads only .* of the bottle .* matt tape"),
        ("scale", 1.01, "the table appears up to .* calibrate it again"),
    ],
)
def test_a_face_that_gives_too_few_readings_is_refused_with_what_helps(
    room: Room, name: str, level: float, said: str
) -> None:
    assert re.search(said, judge(room, spoilt(name, level)).failed)


@pytest.mark.long
def test_light_that_comes_by_the_table_is_flagged_where_it_breaks(room: Room) -> None:
    found = judge(room, spoilt("echo_mm", 10.0))
    assert found.broken
    assert any("seems to lean" in flag for flag in found.flags)
