"""Following the piece, against the truth of rendered scenes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache

import cv2
import numpy as np
import pytest
from table_scenes import AREA, AWAY, Motion, Studio, at, food, studio, tool_mesh

from hw.types import Array, Frame
from perception.errors import TrackingFailed
from perception.piece import PieceDetection, at_home, find_piece, lies_at_home, track_piece
from perception.piece.tracking import HIDDEN_AT_THE_END, LOST_ON_THE_WAY
from perception.sightings import OutcomeUnseen
from perception.types import ObjectTrack, Outcome

HALF = (0.0125, 0.0125, 0.009)
START = (0.68, 0.01)
TIMES = np.arange(0.0, 0.75, 1 / 30)
T0 = 100.0  # where the motion starts on the clock of the frames


def scoop_tool(t: float) -> Array:
    """Forward along the table, then up: the piece is met at 0.2 s."""
    s = float(np.clip(t, 0.0, 0.6))
    x = 0.60 + 0.30 * s
    lift = 0.12 * max(s - 0.4, 0.0)
    return at(x, 0.01, 0.002 + lift, pitch=-0.6 * max(s - 0.4, 0.0))


def scooped(t: float) -> Array:
    """The blade slides under the piece by 5 cm, then carries it."""
    slide = scoop_tool(0.4)
    on = np.linalg.inv(slide) @ at(START[0], START[1], 0.002 + HALF[2])
    return at(*START, HALF[2]) if t < 0.2 else at(*START, HALF[2] + 0.002) if t < 0.4 else scoop_tool(t) @ on


def pushed(t: float) -> Array:
    """The edge pushes it ahead, and it ends on the table."""
    return at(max(START[0], scoop_tool(t)[0, 3] + HALF[0] + 0.02), START[1], HALF[2])


@lru_cache
def scene() -> Studio:
    return studio(food("cylinder", HALF), seed=1)


@lru_cache
def detection() -> PieceDetection:
    frame = scene().still(at(*START, HALF[2]), AWAY)
    return find_piece(frame, scene().model, scene().X_BC, AREA)


def film(piece: Motion, tool: Motion, times_s: Array = TIMES) -> list[Frame]:
    return [Frame(t + T0, f.colour, f.depth_mm) for t in times_s for f in (scene().shot(t, piece, tool),)]


@lru_cache
def scoop() -> tuple[Frame, ...]:
    return tuple(film(scooped, scoop_tool))


def track(
    frames: Sequence[Frame],
    tool: Motion,
    X_BC: Array | None = None,
) -> ObjectTrack:
    s = scene()
    X = s.X_BC if X_BC is None else X_BC
    return track_piece(frames, s.model, X, detection(), tool_mesh(), lambda t: tool(t - T0), T0, 0.6)


def errors_mm(found: ObjectTrack, piece: Motion) -> Array:
    truth = np.stack([piece(t)[:2, 3] for t in found.t_s])
    return np.asarray(1e3 * np.linalg.norm(found.state[:, :2] - truth, axis=1))


@pytest.mark.long
def test_a_scoop_is_followed_onto_the_blade() -> None:
    found = track(scoop(), scoop_tool)
    assert np.percentile(errors_mm(found, scooped), 95) < 1.5
    assert found.outcome is Outcome.ON_BLADE
    truth = np.linalg.inv(scoop_tool(0.7)) @ scooped(0.7)[:, 3]
    assert np.abs(found.end_in_tool_m - truth[:3]).max() < 0.0015
    assert found.confidence.min() > 0.7 and found.flags == ()
    assert found.t_s[0] == pytest.approx(0.0, abs=1e-9)


def test_a_piece_as_dark_as_the_blade_is_followed_onto_it_by_depth() -> None:
    """Its colour says nothing on the blade: it was once found in 1 of 84 frames, and called lost."""
    dark = replace(food("cylinder", HALF), rgb=(0.012, 0.012, 0.012))
    s = studio(dark, seed=1)
    found = find_piece(s.still(at(*START, HALF[2]), AWAY), s.model, s.X_BC, AREA)
    assert np.linalg.norm(found.xy_m - START) < 0.004
    frames = [Frame(t + T0, f.colour, f.depth_mm) for t in TIMES for f in (s.shot(t, scooped, scoop_tool),)]
    followed = track_piece(frames, s.model, s.X_BC, found, tool_mesh(), lambda t: scoop_tool(t - T0), T0, 0.6)
    assert followed.outcome is Outcome.ON_BLADE
    assert np.percentile(errors_mm(followed, scooped), 90) < 5.0


def test_a_push_ends_on_the_table() -> None:
    found = track(film(pushed, scoop_tool), scoop_tool)
    assert np.percentile(errors_mm(found, pushed), 95) < 1.5
    assert found.outcome is Outcome.ON_TABLE


def test_an_error_of_the_camera_pose_is_taken_out_with_the_tool() -> None:
    off = np.eye(4)
    off[:3, :3], _ = cv2.Rodrigues(np.deg2rad([0.1, -0.08, 0.05]))
    off[:3, 3] = 0.0007, -0.0006, 0.0005
    found = track(scoop(), scoop_tool, scene().X_BC @ off)
    assert np.percentile(errors_mm(found, scooped), 95) < 2.5
    assert np.linalg.norm(detection().xy_m - START) < 0.001  # else the test shows nothing


def test_a_tool_far_beside_its_place_is_flagged() -> None:
    off = np.eye(4)
    off[:3, :3], _ = cv2.Rodrigues(np.deg2rad([0.0, 0.45, 0.0]))
    found = track(scoop(), scoop_tool, scene().X_BC @ off)
    assert any("adaptsim calibrate check" in flag for flag in found.flags)


def test_a_tool_that_sits_otherwise_in_the_hand_is_named_and_places_count_from_it() -> None:
    def reported(t: float) -> Array:
        X = scoop_tool(t)
        X[0, 3] += 0.005
        return X

    found = track(scoop(), reported)
    truth = np.linalg.inv(scoop_tool(0.7)) @ scooped(0.7)[:, 3]
    assert np.abs(found.end_in_tool_m - truth[:3]).max() < 0.002
    assert [flag for flag in found.flags if "adaptsim touch-off" in flag] == list(found.flags)


def hiding_tool(reach_m: float) -> Callable[[float], Array]:
    """The blade hovers and passes between camera and piece, as far as `reach_m` beyond it."""

    def pose(t: float) -> Array:
        s = float(np.clip((t - 0.1) / 0.3, 0.0, 1.0))
        return at(START[0] - 0.09 + (0.09 + reach_m) * s, START[1] + 0.02, 0.045 + 0.01 * s, pitch=-0.2)

    return pose


def hidden_share(tool: Motion, t: float) -> float:
    without, part = (
        scene().renderer.render({"piece": piece[None], "tool": pose[None]}, None, scene().rng)[0]
        for piece, pose in ((at(*START, HALF[2]), AWAY), (at(*START, HALF[2]), tool(t)))
    )
    reds = [(c[..., 0].astype(int) - c[..., 2] > 60).sum() for c in (without, part)]
    return float(1 - reds[1] / reds[0])


def test_more_than_half_hidden_is_still_located() -> None:
    tool = hiding_tool(0.040)
    share = hidden_share(tool, 0.7)
    assert 0.5 < share < 0.7
    found = track(film(lambda _: at(*START, HALF[2]), tool), tool)
    assert np.percentile(errors_mm(found, lambda _: at(*START, HALF[2])), 95) < 2.5
    assert found.confidence[-1] == pytest.approx(1 - share, abs=0.15)


def test_a_piece_hidden_at_the_end_has_no_outcome() -> None:
    tool = hiding_tool(0.09)
    with pytest.raises(OutcomeUnseen, match=r"seen in 0 of its last \d frames") as unseen:
        track(film(lambda _: at(*START, HALF[2]), tool), tool)
    assert unseen.value.track.confidence[-1] < 0.15
    assert any("less than 25% of the piece visible" in flag for flag in unseen.value.track.flags)


def test_a_piece_seen_in_one_frame_of_a_film_has_no_outcome() -> None:
    """As dark as a raisin it was once found in 1 of 84 frames, and counted as lost with reward 0."""
    gone = at(*START, -1.0)
    with pytest.raises(OutcomeUnseen, match=r"seen in 1 of the trial's 23 frames"):
        track(film(lambda t: at(*START, HALF[2]) if t < 0.02 else gone, lambda _: AWAY), lambda _: AWAY)


def test_a_film_that_ends_before_the_motion_has_no_outcome() -> None:
    """The camera's cable came loose: the piece that lies there still was counted as missed, without a flag."""
    with pytest.raises(TrackingFailed, match=r"the film ends at 0\.17 s, and the motion at 0\.60 s"):
        track(film(scooped, scoop_tool, TIMES[:6]), scoop_tool)


def test_a_piece_that_rolls_out_of_the_searched_area_is_lost() -> None:
    """The film ends where it left the picture; one that stops there, or is picked up at rest, has not left."""

    def rolls(t: float) -> Array:
        y = START[1] - 0.8 * max(t - 0.3, 0.0)
        return at(START[0], y if y > -0.13 else -0.13, HALF[2] if y > -0.13 else -1.0)

    found = track(film(rolls, lambda _: AWAY), lambda _: AWAY)
    assert found.outcome is Outcome.LOST
    assert "it left the camera's view" in found.flags


def test_a_piece_that_vanishes_is_bridged_with_no_confidence() -> None:
    gone = at(*START, -1.0)
    frames = film(lambda t: gone if 0.31 < t < 0.39 else at(*START, HALF[2]), lambda _: AWAY)
    found = track(frames, lambda _: AWAY)
    missing = (found.t_s > 0.31) & (found.t_s < 0.39)
    assert (found.confidence[missing] == 0).all() and (found.confidence[~missing] > 0.8).all()
    assert any("piece not located in 2 of" in flag for flag in found.flags)
    assert any("camera pose not checked" in flag for flag in found.flags)
    assert found.outcome is Outcome.ON_TABLE


@pytest.mark.parametrize("from_behind_the_tool", [False, True])
def test_a_piece_that_falls_and_rolls_away_between_two_frames_is_found_again(from_behind_the_tool: bool) -> None:
    """At 20 frames/s a piece falls from the blade to the table within one frame."""
    tool = hiding_tool(0.09) if from_behind_the_tool else scoop_tool

    def falls(t: float) -> Array:
        lies = at(*START, HALF[2]) if from_behind_the_tool else scooped(t)
        return lies if t < 0.55 else at(START[0] + 0.15 + 0.2 * (t - 0.55), START[1] - 0.12, HALF[2])

    found = track(film(falls, tool), tool)
    after = found.t_s > 0.55
    assert after.sum() >= 4
    assert errors_mm(found, falls)[after].max() < 2.5
    assert found.outcome is Outcome.ON_TABLE


def test_jpeg_costs_little() -> None:
    frames = []
    for frame in scoop():
        _, data = cv2.imencode(".jpg", frame.colour[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 90])
        frames.append(Frame(frame.t_s, cv2.imdecode(data, cv2.IMREAD_COLOR)[..., ::-1].copy(), frame.depth_mm))
    assert np.percentile(errors_mm(track(frames, scoop_tool), scooped), 95) < 2.0


def test_frames_of_another_clock_are_refused() -> None:
    with pytest.raises(TrackingFailed, match="share one clock"):
        track([Frame(f.t_s - 50, f.colour, f.depth_mm) for f in scoop()], scoop_tool)


def test_a_piece_that_was_taken_away_is_refused() -> None:
    frames = film(lambda _: at(*START, -1.0), lambda _: AWAY)
    with pytest.raises(TrackingFailed, match=r"lay at \(0\.680, 0\.010\) m is in none of"):
        track(frames, lambda _: AWAY)


@pytest.mark.parametrize("place", [None, (0.66, -0.02), (0.685, 0.012), (0.70, 0.03)])
def test_a_piece_that_lies_on_the_table_again_was_lost_on_the_way_home(place: tuple[float, float] | None) -> None:
    """Two pictures with the tool away; `place` is where the piece lies afterwards, None: it came home on the tool."""
    s, gone = scene(), at(*START, -5.0)
    before, after = s.still(at(*START, HALF[2]), AWAY), s.still(gone if place is None else at(*place, HALF[2]), AWAY)
    found = at_home(track(scoop(), scoop_tool), detection(), before, after, s.model, s.X_BC)
    assert found.outcome is (Outcome.ON_BLADE if place is None else Outcome.ON_TABLE)
    assert (LOST_ON_THE_WAY in found.flags) is (place is not None)


@pytest.mark.parametrize("place", [None, (0.66, -0.02), (0.70, 0.03)])
def test_a_piece_whose_end_was_hidden_is_on_the_table_if_it_lies_there_afterwards(
    place: tuple[float, float] | None,
) -> None:
    """`place` is where the piece lies once the arm is home; None: the picture does not show it."""
    s, gone = scene(), at(*START, -5.0)
    before, after = s.still(at(*START, HALF[2]), AWAY), s.still(gone if place is None else at(*place, HALF[2]), AWAY)
    shown = lies_at_home(track(scoop(), scoop_tool), detection(), before, after, s.model, s.X_BC)
    assert (shown is None) is (place is None)
    if shown is not None:
        assert shown.outcome is Outcome.ON_TABLE
        assert HIDDEN_AT_THE_END in shown.flags
