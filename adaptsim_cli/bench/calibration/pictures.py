"""Pictures for people: the corners found in a view, and the arm drawn into all views, which shows an error at a glance.

For views with joints the whole arm is drawn, for others the hand and link 7. The outline of the hand is also compared
with the moving parts of the pictures (`perception.outline`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from adaptsim_cli.bench.calibration.solving import SolvedFolder
from calib.errors import UnusableViews
from calib.types import View
from hw.bounded import encode_image
from hw.capsules import segments
from hw.joint_limits import LIMITS
from hw.kinematics import FLANGE, forward, link_poses
from hw.outline import ARM
from hw.poses import inverse
from hw.types import Array, Intrinsics
from hw.wrist import FINGERS, HAND_BODY, LINK7
from perception.board.types import CalibrationTarget, Corners
from perception.geometry import transform
from perception.outline import OutlineFit, OutlineView, fit, silhouette

ARM_PICTURE = "arm.jpg"
LIMIT_M = 0.008
"""The outline counts as wrong if it fits better after a shift, at the hand, that is larger than this."""
ON_SHEET, COLUMNS, TILE_PX = 6, 3, 640
_WRIST_BALL_M = 0.10  # continues the hand's outline: link 6, at any angle of joint 7
_HAND, _ARM = (60, 60, 235), (235, 170, 60)


@dataclass(frozen=True, eq=False)
class ArmPictures:
    """The drawn pictures, and the fit of the outline."""

    fit: OutlineFit | None
    by_view: dict[str, NDArray[np.uint8]]  # (H, W, 3) BGR

    @property
    def fits(self) -> bool:
        """Whether the outline fits; also False if not measured."""
        return self.fit is not None and self.fit.shift_m <= LIMIT_M

    @property
    def sentence(self) -> str:
        """The measure in words."""
        match = self.fit
        if match is None:
            return (
                "The fit of the hand's outline was not measured: "
                "too few pictures show enough of the hand before the background"
            )
        verdict = "fits" if self.fits else "does not fit"
        return (
            f"The hand's outline {verdict}: it would fit best {match.shift_px[0]:+.0f}, {match.shift_px[1]:+.0f} px "
            f"from where it is drawn, {1e3 * match.shift_m:.0f} mm at the hand (limit {1e3 * LIMIT_M:.0f}); "
            f"{match.off_px:.0f} px in the median of {match.pictures} pictures. It also measures how the drawn hand "
            "differs from the real one, so a few millimetres say nothing; a wrong frame or arm shows as centimetres"
        )

    def as_json(self) -> dict[str, Any] | None:
        """The measurement for JSON; None if not measured."""
        match = self.fit
        if match is None:
            return None
        return {
            "fits": self.fits,
            "shift_px": match.shift_px.tolist(),
            "shift_mm": 1e3 * match.shift_m,
            "middle_view_px": match.off_px,
            "pictures": match.pictures,
        }

    def sheet(self) -> bytes:
        """JPEG of some of the pictures side by side."""
        names = sorted(self.by_view)
        chosen = [names[i] for i in np.unique(np.linspace(0, len(names) - 1, ON_SHEET).astype(int))]
        tiles = [_tile(self.by_view[name], name) for name in chosen]
        tiles += [np.zeros_like(tiles[0])] * (-len(tiles) % COLUMNS)
        rows = [np.hstack(tiles[i : i + COLUMNS]) for i in range(0, len(tiles), COLUMNS)]
        return jpeg(np.vstack(rows).astype(np.uint8))


def draw_arm(solved: SolvedFolder) -> ArmPictures:
    """Draw the arm into the pictures. Raises UnusableViews if it cannot be drawn."""
    record, camera = solved.record, solved.setup.colour
    if record.mounting != "fixed":
        raise UnusableViews("the camera is on the wrist and does not see the arm: there is nothing to draw")
    if record.arm not in LIMITS:
        raise UnusableViews(
            f"the program knows the shapes of {', '.join(LIMITS)} only: name the arm at the top of setup.toml if it is "
            'one of them, for example arm = "fr3"'
        )
    X_CB, offsets_rad = inverse(np.array(record.X_AC)), record.offsets_rad()
    X_FM, outline_m = np.array(record.X_HM), solved.setup.board.outline_m
    board = transform(X_FM, outline_m)
    views, pictures = [], {}
    for view in solved.views:
        picture = _picture(solved, view, camera)
        if picture is None:
            continue
        X_CF = X_CB @ _flange(view, offsets_rad)
        hand = tuple(transform(X_CF, part) for part in HAND_BODY)
        around = (*FINGERS, _ball(np.array([0.0, 0.0, -0.16])), np.concatenate([board, FINGERS[0]]))
        views.append(OutlineView(picture, hand, tuple(transform(X_CF, part) for part in around)))
        wrist = tuple(transform(X_CF, part) for part in (*LINK7, *FINGERS))
        pictures[view.name] = _drawn(picture, camera, (*hand, *wrist), _links(view, offsets_rad, X_CB))
    if not pictures:
        raise UnusableViews("the views have no pictures to draw into")
    return ArmPictures(fit(views, camera), pictures)


def jpeg(image: NDArray[np.uint8]) -> bytes:
    """JPEG of (H, W, 3) BGR."""
    return encode_image(image, ".jpg", 88)


def _picture(solved: SolvedFolder, view: View, camera: Intrinsics) -> NDArray[np.uint8] | None:
    """(H, W, 3) RGB of the view; None if it has no picture of the camera's size."""
    path: Path | None = solved.images.get(view.name)
    image = None if path is None else cv2.imread(str(path), cv2.IMREAD_COLOR)
    if image is None or image.shape[:2] != (camera.height, camera.width):
        return None
    return np.ascontiguousarray(image[..., ::-1], dtype=np.uint8)


def _flange(view: View, offsets_rad: Array) -> Array:
    return forward(view.q_rad + offsets_rad) if view.X_BF is None and view.q_rad is not None else np.array(view.X_BF)


def _links(view: View, offsets_rad: Array, X_CB: Array) -> tuple[Array, ...]:
    """The arm's outline in the camera frame, each capsule as points; empty if joints are unknown."""
    if view.q_rad is None or len(view.q_rad) != FLANGE - 1:
        return ()
    ends = segments(link_poses(view.q_rad + offsets_rad), ARM)
    parts = [
        np.concatenate([end + capsule.radius_m * _SPHERE for end in pair])
        for pair, capsule in zip(ends, ARM, strict=True)
    ]
    return tuple(transform(X_CB, part) for part in parts)


def _sphere() -> Array:
    """(N, 3) points spread over the unit sphere."""
    k = np.arange(120) + 0.5
    polar, turn = np.arccos(1.0 - 2.0 * k / 120), np.pi * (1.0 + np.sqrt(5.0)) * k
    return np.stack([np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar)], axis=1)


_SPHERE = _sphere()


def _ball(centre_m: Array) -> Array:
    return np.asarray(centre_m + _WRIST_BALL_M * _SPHERE)


def _drawn(
    picture: NDArray[np.uint8], camera: Intrinsics, hand: Sequence[Array], links: Sequence[Array]
) -> NDArray[np.uint8]:
    """(H, W, 3) BGR with the outlines; the hand's on top of the links'."""
    image = np.ascontiguousarray(picture[..., ::-1])
    width = max(1, round(camera.width / 640))
    for parts, colour in ((links, _ARM), (hand, _HAND)):
        visible = [mask for part in parts if (mask := silhouette([part], camera)) is not None]
        if visible:
            outlines, _ = cv2.findContours(np.maximum.reduce(visible), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
            cv2.drawContours(image, outlines, -1, colour, width, cv2.LINE_AA)
    return image


def _tile(image: NDArray[np.uint8], name: str) -> NDArray[np.uint8]:
    scale = TILE_PX / image.shape[1]
    small = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    cv2.putText(small, name, (8, 22), cv2.FONT_HERSHEY_SIMPLEX, 0.6, (40, 40, 40), 3, cv2.LINE_AA)
    cv2.putText(small, name, (8, 22), cv2.FONT_HERSHEY_SIMPLEX, 0.6, (255, 255, 255), 1, cv2.LINE_AA)
    return np.asarray(small, dtype=np.uint8)


_OVERLAY_HEIGHT_PX = 720
_OVERLAY_QUALITY = 85


def draw_view(
    colour: NDArray[np.uint8],
    corners: Corners,
    X_CM: Array,
    before: Sequence[Corners],
    board: CalibrationTarget,
    camera: Intrinsics,
) -> bytes:
    """JPEG of the picture (H, W, 3 RGB) with its corners, coloured from blue to red by their ids. Those of earlier
    views are faint.
    """
    scale = max(1, round(camera.height / _OVERLAY_HEIGHT_PX))
    image = np.ascontiguousarray(colour[..., ::-1])
    faint = image.copy()
    for earlier in before:
        for u, v in earlier.px:
            cv2.circle(faint, (round(u), round(v)), 2 * scale, (200, 160, 60), -1, cv2.LINE_AA)
    image = cv2.addWeighted(faint, 0.45, image, 0.55, 0)
    for number, (u, v) in zip(corners.ids, corners.px, strict=True):
        share = number / max(board.corners - 1, 1)
        hue = np.array([[[round(120 * (1 - share)), 255, 255]]], dtype=np.uint8)
        bgr = tuple(int(c) for c in cv2.cvtColor(hue, cv2.COLOR_HSV2BGR)[0, 0])
        cv2.circle(image, (round(16 * u), round(16 * v)), 16 * 4 * scale, bgr, scale, cv2.LINE_AA, shift=4)
        cv2.circle(image, (round(16 * u), round(16 * v)), 16 * scale // 2, bgr, -1, cv2.LINE_AA, shift=4)
    axes = np.vstack([np.zeros(3), 2 * board.spacing_m * np.eye(3)]) @ X_CM[:3, :3].T + X_CM[:3, 3]
    px = cv2.projectPoints(axes, np.zeros(3), np.zeros(3), camera.K, camera.distortion)[0].reshape(-1, 2)
    for end, bgr in zip(px[1:], ((40, 40, 230), (60, 180, 40), (230, 90, 30)), strict=True):
        cv2.arrowedLine(image, _whole(px[0]), _whole(end), bgr, 2 * scale, cv2.LINE_AA, tipLength=0.2)
    return encode_image(image, ".jpg", _OVERLAY_QUALITY)


def _whole(px: Array) -> tuple[int, int]:
    return round(float(px[0])), round(float(px[1]))
