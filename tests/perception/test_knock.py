"""A knocked camera is said to be one; a moving object, a hand and changing light are not."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from boards_in_rooms import photograph
from numpy.typing import NDArray

from hw.types import Frame
from perception.knock import with_knock
from perception.types import ObjectTrack, Outcome

ROOM = cv2.resize(photograph(3), (640, 480))


def plain_table() -> NDArray[np.uint8]:
    """A bright table with a target on a dark floor: little to see but edges."""
    picture = np.full((480, 640, 3), 105, np.uint8)
    cv2.fillPoly(picture, [np.array([[160, 120], [480, 120], [620, 470], [20, 470]])], (198, 196, 188))
    cv2.rectangle(picture, (330, 240), (370, 270), (40, 130, 80), -1)
    return picture


FLAGS = ("a hand or another object is in the picture in 9 of 30 frames (0.40 to 0.70 s)", "the bottle is at the edge")
TRACK = ObjectTrack(np.arange(30) / 30, np.zeros((30, 3)), Outcome.UPRIGHT, np.zeros(3), np.ones(30), FLAGS)


def pictures(
    *,
    shift_px: float = 0.0,
    turn_deg: float = 0.0,
    hand: bool = False,
    dimmer: float = 1.0,
    room: NDArray[np.uint8] = ROOM,
) -> list[Frame]:
    """Thirty frames of a room in which something moves, and after the twelfth what the arguments say."""
    rng, frames = np.random.default_rng(0), []
    for i in range(30):
        picture: NDArray[np.float64] = room.astype(np.float64)
        picture[250:330, 10 * i : 10 * i + 90] = (200.0, 120.0, 60.0)
        if i >= 12:
            if hand:
                picture[80:300, 200:380] = (140.0, 80.0, 60.0)
            move = cv2.getRotationMatrix2D((320.0, 240.0), turn_deg, 1.0)
            move[:, 2] += (shift_px, 0.4 * shift_px)
            picture = dimmer * cv2.warpAffine(picture, move, (640, 480), borderMode=cv2.BORDER_REPLICATE)
        seen = np.clip(picture + rng.normal(0.0, 2.0, picture.shape), 0, 255).astype(np.uint8)
        frames.append(Frame(5.0 + i / 30, seen, np.zeros((4, 4), np.uint16)))
    return frames


@pytest.mark.parametrize("shift_px", [6.0, 15.0, -40.0])
def test_a_knock_is_said_instead_of_a_hand(shift_px: float) -> None:
    flags = with_knock(TRACK, pictures(shift_px=shift_px), 5.0).flags
    assert flags[0].startswith("outcome uncertain: the whole picture moved by")
    assert "from 0.40 s on, so the camera was knocked" in flags[0]
    assert float(flags[0].split("moved by ")[1].split(" px")[0]) == pytest.approx(1.077 * abs(shift_px), abs=1.0)
    assert flags[1:] == FLAGS[1:]


@pytest.mark.parametrize(
    "change", [{}, {"hand": True}, {"dimmer": 0.5}, {"hand": True, "dimmer": 1.3}, {"shift_px": 1.0}]
)
def test_a_camera_that_stands_still_is_not_knocked(change: dict[str, float]) -> None:
    assert with_knock(TRACK, pictures(**change), 5.0) is TRACK  # type: ignore[arg-type]


@pytest.mark.parametrize(("shift_px", "turn_deg", "is_knocked"), [(0.0, 0.0, False), (8.0, -2.0, True)])
def test_the_edges_of_a_plain_table_show_a_knock_that_turns_the_camera(
    shift_px: float, turn_deg: float, is_knocked: bool
) -> None:
    flags = with_knock(TRACK, pictures(shift_px=shift_px, turn_deg=turn_deg, room=plain_table()), 5.0).flags
    assert flags[0].startswith("outcome uncertain: the whole picture moved by") == is_knocked


def test_without_colour_nothing_is_said() -> None:
    black = [replace(frame, colour=np.zeros_like(frame.colour)) for frame in pictures()]
    assert with_knock(TRACK, black, 5.0) is TRACK
