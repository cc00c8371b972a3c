"""Find the piece on the table before a trial, and measure it."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import OptimizeResult, least_squares

from hw.poses import translation
from hw.types import Array, CameraModel, Frame, frozen_array
from perception.errors import ObjectNotFound
from perception.geometry import Area, Array32, ImageRegion, on_plane, transform, view_of
from perception.piece.proxy import Proxy, Shape, coverage


def chromaticity(rgb: NDArray[np.uint8]) -> Array32:
    """(..., 3) -> (..., 2): the shares of red and green in the sum of the channels."""
    values = rgb.astype(np.float32)
    total = values.sum(axis=-1, keepdims=True) + np.float32(6.0)  # black has no colour: pull it towards grey
    return np.asarray((values[..., :2] + np.float32(2.0)) / total, dtype=np.float32)


def matte(rgb: NDArray[np.uint8], piece: Array, others: tuple[Array, ...]) -> Array32:
    """(h, w) share of each pixel that the piece covers, 0 to 1.

    `piece` and `others` (table, tool) are chromaticities (2,). A pixel is placed on the line
    from each of the others to the piece, and the smallest share counts.
    """
    colour = chromaticity(rgb)
    share = np.ones(colour.shape[:2], dtype=np.float32)
    for other in others:
        line = (piece - other).astype(np.float32)
        on_line = (colour - other.astype(np.float32)) @ (line / np.float32(line @ line))
        np.minimum(share, on_line, out=share)
    return np.clip(share, 0, 1, out=share)


_BLACK, _GREY = 0.30, 0.60
"""Two brightnesses, as shares of the table's. Up to the first, a pixel is as dark as a dark piece; from the second on,
it is table, even in a shadow, which leaves 0.72 of the coded values."""


def brightness(rgb: NDArray[np.uint8]) -> Array32:
    """(..., 3) -> (...,) the sum of the channels."""
    return np.asarray(rgb.sum(axis=-1, dtype=np.float32))


def darkness(rgb: NDArray[np.uint8], table: float) -> Array32:
    """(h, w) share of each pixel that a dark piece covers; `table` is the table's brightness."""
    share = (np.float32(_GREY) - brightness(rgb) / np.float32(max(table, 1.0))) / np.float32(_GREY - _BLACK)
    return np.asarray(np.clip(share, 0, 1), dtype=np.float32)


_SURE, _FEWEST = 0.9, 8
_LIT = 80.0
_DARKEST, _DARK = 0.2, 0.5
"""Two brightnesses, as shares of the piece's own in this picture. Below the first, a pixel on the tool shows only the
tool; above the second, it may show the piece."""


def without_halo(share: Array32, rgb: NDArray[np.uint8], on_tool: NDArray[np.bool_]) -> Array32:
    """`share` (h, w) without the rim that a piece gets on a black tool.

    JPEG and demosaicing give dark pixels the colour of their bright neighbours, and only their brightness distinguishes
    them from the piece. `on_tool` (h, w) are the pixels with the tool behind the piece. Elsewhere a dark pixel may be a
    shadow.
    """
    total = rgb.sum(axis=-1, dtype=np.float32)
    sure = share > _SURE
    if sure.sum() < _FEWEST:
        return share
    lit = (total / np.percentile(total[sure], _LIT) - _DARKEST) / (_DARK - _DARKEST)
    return np.where(on_tool, np.minimum(share, np.clip(lit, 0, 1)), share).astype(np.float32)


def typical(colour: Array32) -> tuple[Array, float]:
    """Median chromaticity (2,) of (n, 2) and the spread around it (one standard deviation, robustly)."""
    centre = np.median(colour, axis=0).astype(np.float64)
    spread = 1.4826 * np.median(np.abs(colour - centre.astype(np.float32)), axis=0)
    return centre, float(max(spread.max(), 1e-3))


HEIGHT_M = 0.04
"""The tallest piece that is searched for (m)."""
_MARGIN_M = 0.04  # the search extends this far around the area, to report a misplaced piece
_USUAL_HEIGHT_M, _FLAT_M = 0.016, 0.006
_SMALLEST_M, _LARGEST_M = 0.004, 0.030  # plausible radius
_SHALLOWEST_M = 0.003  # plausible half width away from the camera, of which the outline says little: a raisin's 7 mm
_MATTE_NOISE = 0.2
_DEPTH_NOISE_M, _DEPTH_CLIP_M = 0.0025, 0.008
_UNROUND_M = 0.0007
"""Usual difference of the two half widths. The outline hardly tells how far a piece reaches away from the camera."""


@dataclass(frozen=True, eq=False)
class PieceDetection:
    """A piece lying on the table: the input of tracking."""

    xy_m: Array  # (2,) centre in the base frame
    proxy: Proxy  # the body that stands for it; axes along those of the base frame
    contour_px: Array  # (K, 2) outline in the colour image
    confidence: float  # 0 ... 1, how well the proxy explains outline and depth
    piece_chroma: Array  # (2,) chromaticity of the piece
    table_chroma: Array  # (2,) chromaticity of the table around it
    depth_offset_m: float  # measured minus expected depth of the bare table around it
    is_dark: bool = False  # its brightness tells it from the table, and its colour says nothing

    def __post_init__(self) -> None:
        object.__setattr__(self, "xy_m", frozen_array(self.xy_m, (2,), "xy_m"))

    @property
    def radius_m(self) -> float:
        """Mean half width."""
        return (self.proxy.half_m[0] + self.proxy.half_m[1]) / 2

    @property
    def height_m(self) -> float:
        """The piece's height over the table."""
        return 2 * self.proxy.half_m[2]

    @property
    def near_m(self) -> Array:
        """(2,) middle of the side that faces the robot: x, y in the base frame."""
        return self.xy_m - [self.proxy.half_m[0], 0.0]

    @property
    def shape(self) -> Shape:
        """The shape that explains the picture best; a hint, not a measurement."""
        return self.proxy.shape

    @property
    def centre_m(self) -> Array:
        """(3,) in the base frame."""
        return np.array([*self.xy_m, self.proxy.half_m[2]])


def find_piece(frame: Frame, model: CameraModel, X_BC: Array, area: Area) -> PieceDetection:
    """The one piece that lies with its centre in `area` (x_low, x_high, y_low, y_high), metres.

    `X_BC` (4, 4) is the colour camera in the base frame, whose plane z = 0 is the table top.
    Raises ObjectNotFound, naming the objects that are there, if there is none or more than one.
    """
    view = view_of(model.colour, X_BC, area, HEIGHT_M, _MARGIN_M)
    rgb = frame.colour[view.rows, view.columns]
    colour = chromaticity(rgb)
    table, spread = typical(colour.reshape(-1, 2))
    bright = float(np.median(brightness(rgb)))
    dark = darkness(rgb, bright)
    spots = _spots(colour, dark, table, spread, view, area)
    inside = [spot for spot in spots if spot.in_area]
    if len(inside) != 1:
        raise ObjectNotFound(_complaint(inside, spots, area))
    spot = inside[0]
    core = cv2.erode(spot.mask, np.ones((3, 3), np.uint8)) > 0
    piece, _ = typical(colour[core if core.sum() >= 8 else spot.mask > 0])
    is_dark = bool(np.median(dark[spot.mask > 0]) > _MOSTLY)
    share = dark.copy() if is_dark else matte(rgb, piece, (table,))
    share[cv2.dilate(spot.mask, np.ones((7, 7), np.uint8)) == 0] = 0
    proxy, xy_m, offset_m, confidence = _measure(frame, model, view, share, spot)
    widest, narrowest = max(proxy.half_m[:2]), min(proxy.half_m[:2])
    if not (narrowest >= _SHALLOWEST_M and _SMALLEST_M <= widest <= _LARGEST_M):
        raise ObjectNotFound(
            f"the spot at x = {xy_m[0]:.3f}, y = {xy_m[1]:.3f} m measures {2e3 * proxy.half_m[0]:.0f} x "
            f"{2e3 * proxy.half_m[1]:.0f} mm; a piece measures {2e3 * _SMALLEST_M:.0f} to {2e3 * _LARGEST_M:.0f} mm. "
            f"Clear the area of everything but the piece"
        )
    contours, _ = cv2.findContours((share > 0.5).astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    corner = np.array([view.columns.start, view.rows.start], dtype=np.float64)
    contour = max(contours, key=cv2.contourArea).reshape(-1, 2) + corner
    return PieceDetection(xy_m, proxy, contour, confidence, piece, table, offset_m, is_dark)


@dataclass(frozen=True, eq=False)
class _Spot:
    mask: NDArray[np.uint8]  # (h, w) of the view
    xy_m: Array  # (2,) roughly
    in_area: bool


_MOSTLY = 0.7


def _spots(colour: Array32, dark: Array32, table: Array, spread: float, view: ImageRegion, area: Area) -> list[_Spot]:
    """Every spot of another colour than the table, or much darker, at least as large as the smallest piece, whole in
    the view.
    """
    other = np.linalg.norm(colour - table.astype(np.float32), axis=-1) > max(6 * spread, 0.02)
    other |= dark > _MOSTLY
    mask = cv2.morphologyEx(other.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    count, labels, stats, centroids = cv2.connectedComponentsWithStats(mask, connectivity=4)
    height, width = mask.shape
    range_m = transform(view.X_VB, np.array([(area[0] + area[1]) / 2, (area[2] + area[3]) / 2, 0.0]))[2]
    smallest_px = max(0.6 * np.pi * (_SMALLEST_M * view.focal_px / range_m) ** 2, 4.0)
    spots = []
    for label in range(1, count):
        left, top, w, h, size = stats[label]
        touches = left == 0 or top == 0 or left + w == width or top + h == height
        if size < smallest_px or touches:
            continue
        u, v = centroids[label]
        ideal = view.xy[int(np.rint(v)), int(np.rint(u))].astype(np.float64)
        ray = np.array([[*(ideal / view.focal_px), 1.0]])
        xy = on_plane(ray, view.X_BV, _USUAL_HEIGHT_M / 2)[0]
        in_area = bool(area[0] <= xy[0] <= area[1] and area[2] <= xy[1] <= area[3])
        spots.append(_Spot((labels == label).astype(np.uint8), xy, in_area))
    return spots


def _complaint(inside: list[_Spot], spots: list[_Spot], area: Area) -> str:
    where = f"x {area[0]:.3f} to {area[1]:.3f}, y {area[2]:.3f} to {area[3]:.3f} m"
    if len(inside) > 1:
        places = ", ".join(f"({s.xy_m[0]:.3f}, {s.xy_m[1]:.3f})" for s in inside)
        return f"{len(inside)} objects lie in {where}: at {places} m; leave one and take the others away"
    if spots:
        near = spots[0].xy_m
        return f"nothing lies in {where}, but something lies at ({near[0]:.3f}, {near[1]:.3f}) m; move it into the area"
    return (
        f"nothing lies in {where}: no spot differs in colour from the table; put the piece there, and make sure that "
        "its colour differs from the table's"
    )


def _measure(
    frame: Frame, model: CameraModel, view: ImageRegion, share: Array32, spot: _Spot
) -> tuple[Proxy, Array, float, float]:
    """Shape, size and place that explain the matte and the depth around the spot best."""
    rough = np.array([*spot.xy_m, _USUAL_HEIGHT_M / 2])
    near = view.window(rough, 2 * _LARGEST_M)
    depth_view = depth_window(model, view.X_BV, rough)
    if near is None:
        raise ObjectNotFound("the piece lies at the rim of the camera's image; move the camera or the piece")
    top, left = near.rows.start - view.rows.start, near.columns.start - view.columns.start
    h, w = near.xy.shape[:2]
    alpha = share[top : top + h, left : left + w].reshape(-1)
    xy = near.xy.reshape(-1, 2)
    directions = depth_view.directions
    table_m = table_depth(depth_view)
    depth_m = frame.depth_mm[depth_view.rows, depth_view.columns].reshape(-1) / 1000.0
    offset_m = table_offset(depth_m, depth_view, rough)
    valid = depth_m > 0
    rays, table_m, read_m = directions[valid], table_m[valid], depth_m[valid] - offset_m

    def residuals(p: Array, shape: Shape) -> Array:
        proxy, X_BO = Proxy(shape, (p[2], p[3], p[4])), translation([p[0], p[1], p[4]])
        pixels, covered, _ = coverage(proxy.outline(X_BO, near), xy)
        cover = np.zeros(len(xy))
        cover[pixels] = covered
        front = proxy.depth(X_BO, depth_view, rays)
        off = np.clip(read_m - np.minimum(front, table_m), -_DEPTH_CLIP_M, _DEPTH_CLIP_M)
        return np.concatenate([(alpha - cover) / _MATTE_NOISE, off / _DEPTH_NOISE_M, [(p[2] - p[3]) / _UNROUND_M]])

    metres_per_px = transform(view.X_VB, rough)[2] / view.focal_px
    radius = float(np.clip(0.9 * np.sqrt(alpha.sum() / np.pi) * metres_per_px, _SMALLEST_M, _LARGEST_M))
    starts = [np.array([*spot.xy_m, radius, radius, height_m / 2]) for height_m in (_USUAL_HEIGHT_M, _FLAT_M)]
    low = np.array([*(spot.xy_m - 0.03), _SHALLOWEST_M, _SHALLOWEST_M, 0.002])
    high = np.array([*(spot.xy_m + 0.03), 0.05, 0.05, HEIGHT_M / 2 + 0.005])
    step = 3e-4 / np.maximum(np.abs(starts[0]), 1e-2)

    def fitted(shape: Shape, start: Array) -> OptimizeResult:
        bounds, scale = (low, high), np.full(5, 1e-3)
        return least_squares(residuals, start, bounds=bounds, x_scale=scale, diff_step=step, args=(shape,), max_nfev=60)

    fits = [(shape, fitted(shape, start)) for shape in Shape for start in starts]
    shape, best = min(fits, key=lambda fit: float(fit[1].cost))
    x, y, half_x, half_y, half_z = best.x
    miss = np.abs(best.fun[: len(alpha)] * _MATTE_NOISE).sum() / max(alpha.sum(), 1.0)
    proxy = Proxy(shape, (float(half_x), float(half_y), float(half_z)))
    return proxy, np.array([x, y]), offset_m, float(np.clip(1.15 - miss, 0, 1))


def depth_window(model: CameraModel, X_BC: Array, centre_m: Array) -> ImageRegion:
    """The part of the depth image around a piece at `centre_m` (3,)."""
    reach = 2.2 * _LARGEST_M
    box = (centre_m[0] - reach, centre_m[0] + reach, centre_m[1] - reach, centre_m[1] + reach)
    return view_of(model.depth, X_BC @ model.X_CD, box, 0.0)


def table_depth(view: ImageRegion) -> Array:
    """(n,) depth of the plane z = 0 of the base frame along the rays of `view`."""
    depth: Array = -view.X_BV[2, 3] / (view.directions.astype(np.float64) @ view.X_BV[2, :3])
    return depth


def table_offset(depth_m: Array, view: ImageRegion, centre_m: Array, clear: NDArray[np.bool_] | None = None) -> float:
    """Median of measured minus expected depth (n,) on the bare table around a piece; 0 if too little of it is seen.

    It removes the sensor's systematic error there. `clear` (n,) excludes pixels known not to be table.
    """
    foot_m = on_plane(view.directions.astype(np.float64), view.X_BV, 0.0)
    use = (depth_m > 0) & (np.linalg.norm(foot_m - centre_m[:2], axis=1) > 1.3 * _LARGEST_M)
    if clear is not None:
        use &= clear
    off = (depth_m - table_depth(view))[use]
    off = off[np.abs(off) < 0.02]
    return float(np.median(off)) if len(off) >= 30 else 0.0
