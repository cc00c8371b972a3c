"""The measure of an outline, on pictures that are drawn here: a grey room, and a bright body that moves in it."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from hw.types import Array, Intrinsics
from perception.outline import OutlineView, changes, fit, silhouette

CAMERA = Intrinsics(640, 480, np.array([[600.0, 0, 319.5], [0, 600.0, 239.5], [0, 0, 1.0]]))
SIZE_M = np.array([0.20, 0.07, 0.05])


def box(centre_m: Array) -> Array:
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    return centre_m + signs * SIZE_M / 2


def series(off_m: Array, pictures: int = 8, contrast: float = 90.0) -> list[OutlineView]:
    """The body at places all over the picture, drawn `off_m` from where it is said to be."""
    rng = np.random.default_rng(0)
    room = cv2.GaussianBlur(rng.uniform(60.0, 140.0, (480, 640, 3)), (0, 0), 4)
    seen = []
    for i in range(pictures):
        at = np.array([-0.25 + 0.5 * i / pictures, 0.15 * np.sin(2.0 * i), 0.9])
        mask = silhouette([box(at + off_m)], CAMERA)
        assert mask is not None
        picture = room + contrast * mask[..., None] + rng.normal(0.0, 3.0, room.shape)
        seen.append(OutlineView(np.clip(picture, 0, 255).astype(np.uint8), (box(at),), (np.full((1, 3), 0.9),)))
    return seen


@pytest.mark.parametrize(
    ("off_m", "px"), [((0.0, 0.0, 0.0), (0, 0)), ((0.012, 0.0, 0.0), (8, 0)), ((0.0, -0.012, 0.0), (0, -8))]
)
def test_an_outline_in_its_place_fits_and_one_that_lies_off_is_measured(
    off_m: tuple[float, ...], px: tuple[int, int]
) -> None:
    found = fit(series(np.array(off_m)), CAMERA)
    assert found is not None
    assert np.abs(found.shift_px - px).max() <= 1.0
    assert found.shift_m == pytest.approx(np.linalg.norm(off_m), abs=0.002)
    assert found.off_px <= np.linalg.norm(px) + 1.5


APART = [series(0.012 * np.array([np.cos(turn), np.sin(turn), 0.0])) for turn in (0.0, 2.1, 4.2)]


@pytest.mark.parametrize(
    "seen",
    [
        pytest.param(series(np.zeros(3), contrast=0.0), id="a body that does not stand out"),
        pytest.param([APART[i % 3][i] for i in range(8)], id="pictures that ask for different shifts"),
        pytest.param(series(np.zeros(3), pictures=4), id="too few pictures"),
    ],
)
def test_what_is_not_measured(seen: list[OutlineView]) -> None:
    """Different shifts: as of a hand that a board hides. What is left of its outline fits now here, now there."""
    assert fit(seen, CAMERA) is None


def test_what_is_behind_the_camera_has_no_outline() -> None:
    assert silhouette([box(np.array([0.0, 0.0, 0.05]))], CAMERA) is None


def test_the_room_itself_does_not_change() -> None:
    moved = changes([one.colour for one in series(np.zeros(3))])
    assert float(np.median(np.stack(moved))) < 0.3
