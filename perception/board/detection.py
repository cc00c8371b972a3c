"""The calibration board in an image: `draw`, `detect`, `locate`.

OpenCV finds and reads the markers. They alone give the board's place to a pixel or two, enough to predict every inner
corner. Each corner is then refined on its own saddle of grey values, and kept only if it agrees with its neighbours. So
a corner beside an unreadable marker counts as well.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from hw.poses import pose
from hw.types import Array, Intrinsics
from perception.board.types import DICTIONARIES, Board, BoardPose, CalibrationTarget, Corners
from perception.errors import BoardMirrored, BoardNotFound, WrongBoard

Grey = NDArray[np.uint8]

_MIN_MARKERS = 3
_AMBIGUOUS = 1.5  # ambiguous if the mirror pose fits worse by less than this factor
_STRAY_PX = 1.0  # a refined corner farther than this (or 5 sigma) from the others' prediction is dropped
_BENT = 0.15  # of a marker's edge: a corner this far from the plane of the others still belongs to the board
_SCALES = (1, 2, 3)  # if too few markers are read, images are enlarged
_MAX_PX = 2.5e7  # but not beyond this many pixels


def draw(board: Board, square_px: int, margin_px: int = 0) -> Grey:
    """The print, black and white, to scale: (down x square_px + 2 margin, across x square_px + 2 margin) pixels."""
    width, height = board.squares_across * square_px, board.squares_down * square_px
    size = (width + 2 * margin_px, height + 2 * margin_px)
    return np.asarray(_charuco(board).generateImage(size, marginSize=margin_px, borderBits=1), dtype=np.uint8)


def detect(image: NDArray[np.uint8] | NDArray[np.uint16], board: Board, camera: Intrinsics) -> Corners:
    """Inner corners of `board` in a colour (H, W, 3 RGB), grey or infrared (H, W) image of `camera`.

    Raises BoardNotFound, WrongBoard or BoardMirrored, which name what is visible.
    """
    require_size(image, camera)
    grey = in_grey(image)
    points, px = _markers(grey, board)
    if len(points) < 4 * _MIN_MARKERS:
        _explain(grey, board, len(points) // 4)
    predicted = _predict(points, px, board, camera)
    return _refine(grey, predicted, board, camera)


def require_size(image: NDArray[np.generic], camera: Intrinsics) -> None:
    """Raises WrongBoard for an image of another size than the camera's."""
    if image.shape[:2] != (camera.height, camera.width):
        raise WrongBoard(
            f"the image is {image.shape[1]} x {image.shape[0]}, the intrinsics are for {camera.width} x "
            f"{camera.height}: use the intrinsics for this resolution"
        )


def locate(corners: Corners, board: CalibrationTarget, camera: Intrinsics) -> BoardPose:
    """Pose of the board in the camera. Raises BoardNotFound for fewer than `board.least` points or all on one line.

    A flat board seen from afar or nearly head-on has a second pose, tilted the other way, that explains the image
    almost as well. The better pose is returned; `ambiguous` says that the other cannot be excluded.
    """
    points = board.p_MK_m[corners.ids]
    if len(points) < board.least or in_a_row(points, board.spacing_m):
        raise BoardNotFound(f"{len(points)} corners of the board, not enough in both directions for a pose")
    return _poses(points, corners.px, camera)


def in_a_row(points_m: Array, spacing_m: float) -> bool:
    """Whether points (K, 3) lie along one line, which leaves the rotation about it undetermined."""
    spread = np.linalg.svd(points_m - points_m.mean(axis=0), compute_uv=False) if len(points_m) > 2 else np.zeros(2)
    return bool(spread[1] < 0.5 * spacing_m)


def is_flat(points_m: Array) -> bool:
    """Whether points (K, 3) lie in a plane, to a thousandth of their extent."""
    spread = np.linalg.svd(points_m - points_m.mean(axis=0), compute_uv=False)
    return len(spread) < 3 or bool(spread[2] < 1e-3 * spread[0])


def starts(points_m: Array, px: Array, camera: Intrinsics) -> list[Array]:
    """Poses X_CM (4, 4) before the camera that explain points (K, 3) at pixels (K, 2): two if the points are flat."""
    method = cv2.SOLVEPNP_IPPE if is_flat(points_m) else cv2.SOLVEPNP_SQPNP
    try:
        _, rvecs, tvecs, _ = cv2.solvePnPGeneric(points_m, px, camera.K, camera.distortion, flags=method)
    except cv2.error:
        return []
    poses = []
    for r, t in zip(rvecs, tvecs, strict=True):
        X = pose(cv2.Rodrigues(r)[0], np.ravel(t))
        if np.isfinite(X).all() and X[2, 3] > 0:
            poses.append(X)
    return poses


def _poses(points: Array, px: Array, camera: Intrinsics) -> BoardPose:
    solutions = []
    for start in starts(points, px, camera):
        r, t = cv2.solvePnPRefineLM(
            points, px, camera.K, camera.distortion, cv2.Rodrigues(start[:3, :3])[0], start[:3, 3:].copy()
        )
        again, _ = cv2.projectPoints(points, r, t, camera.K, camera.distortion)
        rms = float(np.sqrt(np.mean(np.sum((again.reshape(-1, 2) - px) ** 2, axis=1))))
        X = pose(cv2.Rodrigues(r)[0], t.ravel())
        if X[2, 3] > 0:
            solutions.append((rms, X))
    if not solutions:
        raise BoardNotFound("the corners have no pose in front of the camera: check the intrinsics")
    solutions.sort(key=lambda item: item[0])
    rms, X = solutions[0]
    other_rms, other = solutions[1] if len(solutions) > 1 else (np.inf, None)
    if other is not None and np.allclose(other, X, atol=1e-4):  # both starts ended in the same place
        other_rms, other = np.inf, None
    return BoardPose(X, rms, other, bool(other_rms < _AMBIGUOUS * rms))


def in_grey(image: NDArray[np.uint8] | NDArray[np.uint16]) -> Grey:
    """Eight-bit grey. An infrared image, dark with a few glaring spots, is stretched between its percentiles."""
    if image.ndim == 3:
        return np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), dtype=np.uint8)
    if image.dtype == np.uint8:
        return np.ascontiguousarray(image, dtype=np.uint8)
    low, high = np.percentile(image, (0.5, 99.0))
    stretched = (image.astype(np.float64) - low) * (255.0 / max(float(high - low), 1.0))
    return np.asarray(np.clip(np.rint(stretched), 0, 255), dtype=np.uint8)


def dictionary_named(name: str) -> cv2.aruco.Dictionary:
    """OpenCV's dictionary of that name, a key of DICTIONARIES."""
    attribute = f"DICT_{name}".lower()
    number = next(getattr(cv2.aruco, key) for key in dir(cv2.aruco) if key.lower() == attribute)
    return cv2.aruco.getPredefinedDictionary(number)


def _charuco(board: Board) -> cv2.aruco.CharucoBoard:
    size = (board.squares_across, board.squares_down)
    charuco = cv2.aruco.CharucoBoard(size, board.square_m, board.marker_m, dictionary_named(board.dictionary))
    charuco.setLegacyPattern(board.legacy)
    return charuco


def read_markers(
    grey: Grey, dictionary: str, scale: int, refinement: int = cv2.aruco.CORNER_REFINE_SUBPIX
) -> tuple[NDArray[np.int64], Array]:
    """Marker ids (N,) and their corners (N, 4, 2) in pixels of `grey`, which is enlarged by `scale` first."""
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = refinement
    parameters.minMarkerPerimeterRate = 0.01
    parameters.relativeCornerRefinmentWinSize = 0.2
    big = grey if scale == 1 else cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC)
    corners, ids, _ = cv2.aruco.ArucoDetector(dictionary_named(dictionary), parameters).detectMarkers(big)
    if ids is None:
        return np.zeros(0, dtype=np.int64), np.zeros((0, 4, 2))
    px = (np.concatenate(corners).astype(np.float64) + 0.5) / scale - 0.5
    return ids.ravel().astype(np.int64), px.reshape(-1, 4, 2)


def _markers(grey: Grey, board: Board) -> tuple[Array, Array]:
    """Corners of the markers read: (4 N, 3) on the board and (4 N, 2) in the image."""
    best: tuple[NDArray[np.int64], Array] = (np.zeros(0, dtype=np.int64), np.zeros((0, 4, 2)))
    for scale in _SCALES:
        if scale > 1 and scale**2 * grey.size > _MAX_PX:
            break
        ids, px = read_markers(grey, board.dictionary, scale)
        if len(ids) > len(best[0]):
            best = ids, px
        if len(best[0]) >= 0.6 * board.markers:
            break
    ids, px = best
    strange = np.unique(ids[ids >= board.markers])
    if len(strange) > len(np.unique(ids)) / 2:  # fewer may lie about in the room, or be misread
        raise WrongBoard(
            f"the board has markers 0 to {board.markers - 1}, the image shows {', '.join(map(str, strange[:6]))}:"
            " it is another board, or its stated size is wrong"
        )
    usable = (ids < board.markers) & (np.bincount(ids, minlength=1)[ids] == 1 if len(ids) else ids < 0)
    places = np.array(_charuco(board).getObjPoints(), dtype=np.float64)  # (markers, 4, 3)
    return places[ids[usable]].reshape(-1, 3), px[usable].reshape(-1, 2)


def _explain(grey: Grey, board: Board, markers: int) -> None:
    """Raise with the likeliest reason why so few markers were read."""
    for scale in (1, 2):
        if scale**2 * grey.size > _MAX_PX:
            break
        if len(read_markers(np.ascontiguousarray(grey[:, ::-1]), board.dictionary, scale)[0]) >= max(
            _MIN_MARKERS, 2 * markers
        ):
            raise BoardMirrored(
                "the image or the print is mirrored: switch off mirroring in the camera's driver,"
                " or print the board again, not mirrored"
            )
        for other in DICTIONARIES:
            same_bits = other.split("_")[0] == board.dictionary.split("_")[0]
            if same_bits or not other.endswith(("_1000", "36h11")):
                continue
            read = len(read_markers(grey, other, scale)[0])
            if read >= max(_MIN_MARKERS + 2, 2 * markers):
                raise WrongBoard(
                    f"{read} markers of the family {other.split('_')[0]} are in the image, the board should have"
                    f" {board.dictionary}: use that board, or state yours"
                )
    raise BoardNotFound(
        f"{markers} of the board's {board.markers} markers can be read, but {_MIN_MARKERS} are needed:"
        " the board is out of the image, too far, blurred, too dark or overexposed"
    )


def _predict(points: Array, px: Array, board: Board, camera: Intrinsics) -> Array:
    """(corners, 2) where the inner corners should be. Raises WrongBoard if the markers do not lie as on the board."""
    flat = cv2.undistortPoints(px[:, None], camera.K, camera.distortion).reshape(-1, 2)
    focal = float(np.sqrt(camera.K[0, 0] * camera.K[1, 1]))
    marker_px = float(np.median(np.linalg.norm(np.diff(px.reshape(-1, 4, 2), axis=1), axis=-1)))
    for limit_px in (3.0, max(3.0, _BENT * marker_px)):  # the second for a bent print, or an unknown lens
        H, good = cv2.findHomography(points[:, :2], focal * flat, cv2.RANSAC, limit_px)
        share = 0.0 if H is None else float(np.mean(good))
        if share >= 0.6:
            break
    if share < 0.6:
        raise WrongBoard(
            f"only {100 * share:.0f} % of the marker corners lie as on a board of {board.squares_across} x"
            f" {board.squares_down} squares, markers {board.marker_m / board.square_m:.2f} of a square:"
            " it is another board, or its stated size is wrong"
        )
    grid = np.column_stack([board.p_MK_m[:, :2], np.ones(board.corners)]) @ H.T
    rays = np.column_stack([grid[:, :2] / grid[:, 2:] / focal, np.ones(board.corners)])
    uv, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), camera.K, camera.distortion)
    return np.asarray(uv, dtype=np.float64).reshape(-1, 2)


def _refine(grey: Grey, predicted: Array, board: Board, camera: Intrinsics) -> Corners:
    """Each corner on its own saddle; strays are dropped."""
    square_px = _square_px(predicted, board)
    half = int(np.clip(round(0.28 * square_px), 2, 12))
    rim = half + 2
    inside = ((predicted > rim) & (predicted < [camera.width - 1 - rim, camera.height - 1 - rim])).all(axis=1)
    ids = np.flatnonzero(inside)
    if len(ids) >= board.least:
        start = predicted[ids].astype(np.float32)[:, None]
        stop = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 60, 1e-3)
        # A wide window finds the corner from the prediction, but markers' corners inside the window pull it by up to
        # 0.4 px. A second window that ends before them is good to 0.05 px (rendered views).
        fine = max(2, round(0.96 * _inset(board) * square_px))
        wide = cv2.cornerSubPix(grey, start.copy(), (half, half), (-1, -1), stop)
        refined = cv2.cornerSubPix(grey, wide, (fine, fine), (-1, -1), stop).reshape(-1, 2).astype(np.float64)
        near = np.linalg.norm(refined - predicted[ids], axis=1) < max(0.25 * square_px, 2.0)
        keep = near & _saddle(grey, refined, half)
        ids, px = ids[keep], refined[keep]
        ids, px = _without_strays(ids, px, board, camera)
    if len(ids) < board.least:
        raise BoardNotFound(
            f"{len(ids)} of the board's {board.corners} corners are sharp and visible, but {board.least} are needed: "
            "show more of the board, bring it closer, and keep it still"
        )
    return Corners(ids, px)


def _inset(board: Board) -> float:
    """The distance of a marker from the edge of its square, as a share of the square's edge length."""
    return (1.0 - board.marker_m / board.square_m) / 2.0


def _square_px(predicted: Array, board: Board) -> float:
    grid = predicted.reshape(board.squares_down - 1, board.squares_across - 1, 2)
    steps = [np.linalg.norm(np.diff(grid, axis=axis), axis=-1).ravel() for axis in (0, 1)]
    return float(np.percentile(np.concatenate(steps), 10))


def _saddle(grey: Grey, px: Array, half: int) -> NDArray[np.bool_]:
    """(N,) whether the second derivatives of the patch show a saddle, with opposite quarters alike and neighbours
    different.
    """
    px = np.clip(px, 0.0, [grey.shape[1] - 1.0, grey.shape[0] - 1.0])
    sigma = max(0.35 * half, 0.8)
    rim = 4 * half + 4
    low = np.maximum(np.floor(px.min(axis=0)).astype(int) - rim, 0)
    high = np.ceil(px.max(axis=0)).astype(int) + rim
    patch = grey[low[1] : high[1], low[0] : high[0]]
    soft = cv2.GaussianBlur(patch, (0, 0), sigma).astype(np.float32)
    xx, yy, xy = (cv2.Sobel(soft, cv2.CV_32F, dx, dy, ksize=3) for dx, dy in ((2, 0), (0, 2), (1, 1)))
    u, v = np.rint(px - low).astype(int).T
    u, v = np.clip(u, 0, patch.shape[1] - 1), np.clip(v, 0, patch.shape[0] - 1)
    determinant = (xx * yy - xy * xy)[v, u]
    saddle: NDArray[np.bool_] = determinant < -4.0  # grey values to the fourth order; a flat patch has about 0
    return saddle


def _without_strays(
    ids: NDArray[np.int64], px: Array, board: Board, camera: Intrinsics
) -> tuple[NDArray[np.int64], Array]:
    for _ in range(5):
        if len(ids) < board.least:
            break
        pose = _poses(board.p_MK_m[ids], px, camera)
        rvec = cv2.Rodrigues(pose.X_VM[:3, :3])[0]
        again, _ = cv2.projectPoints(board.p_MK_m[ids], rvec, pose.X_VM[:3, 3], camera.K, camera.distortion)
        off = np.linalg.norm(again.reshape(-1, 2) - px, axis=1)
        limit = max(_STRAY_PX, 4.0 * float(np.median(off)))
        if off.max() <= limit:
            break
        keep = off < max(limit, 0.6 * off.max())  # the worst first: it bends the fit
        ids, px = ids[keep], px[keep]
    return ids, px
