"""What every camera does: the lab's two, the Kinect's driver over a stand-in, and a real Kinect."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import cameras
import numpy as np
import pytest
from cameras import Scene

from hw.errors import CameraError, DeviceUnavailable
from hw.ports import Camera
from hw.types import CameraModel, Frame

SCENES: dict[str, Callable[[], Scene]] = {
    "lab": cameras.lab,
    "board-lab": cameras.board_lab,
    "kinect": cameras.kinect,
    "realsense": cameras.realsense,
}
REAL = pytest.param(cameras.real_kinect, id="real", marks=pytest.mark.hardware)
SPOILT = ("lab", "kinect", "realsense")
ROUNDING_S = 1e-5


def over(*names: str) -> list[object]:
    """Those that need an extra of the program are marked so."""
    marks = {"realsense": pytest.mark.extra}
    return [pytest.param(SCENES[name], id=name, marks=marks.get(name, ())) for name in names]


@pytest.fixture(params=[*over(*SCENES), REAL])
def scene(request: pytest.FixtureRequest) -> Scene:
    made: Scene = request.param()
    return made


def film(scene: Scene) -> Sequence[Frame]:
    scene.camera.start_recording()
    scene.passes()
    return scene.camera.stop_recording()


def uses(camera: Camera) -> tuple[Callable[[], object], ...]:
    return camera.snapshot, camera.start_recording, camera.stop_recording


def fits(frame: Frame, model: CameraModel) -> bool:
    colour, depth = model.colour, model.depth
    images: list[tuple[np.ndarray, type, tuple[int, ...]]] = [
        (frame.colour, np.uint8, (colour.height, colour.width, 3))
    ]
    images.append((frame.depth_mm, np.uint16, (depth.height, depth.width)))
    if frame.infrared is not None:
        images.append((frame.infrared, np.uint16, (depth.height, depth.width)))
    return all(image.dtype == kind and image.shape == shape for image, kind, shape in images)


def test_it_must_be_entered(scene: Scene) -> None:
    for use in uses(scene.camera):
        with pytest.raises(DeviceUnavailable, match="not connected"):
            use()


def test_left_it_is_unavailable_and_can_be_entered_again(scene: Scene) -> None:
    with scene.camera as camera:
        assert camera is scene.camera
        serial = camera.model().serial
    for use in uses(camera):
        with pytest.raises(DeviceUnavailable, match="not connected"):
            use()
    with camera:
        assert camera.model().serial == serial
        camera.snapshot()


def test_the_model_is_of_a_pinhole_camera_and_a_rigid_pose(scene: Scene) -> None:
    with scene.camera as camera:
        model = camera.model()
    assert model.serial
    for lens in (model.colour, model.depth):
        assert lens.width > 0
        assert lens.height > 0
        assert lens.K[0, 0] > 0.0
        assert lens.K[1, 1] > 0.0
        np.testing.assert_array_equal(lens.K[[1, 2, 2], [0, 0, 1]], 0.0)
        assert lens.K[2, 2] == 1.0
    np.testing.assert_allclose(model.X_CD[:3, :3] @ model.X_CD[:3, :3].T, np.eye(3), atol=1e-6)
    assert np.linalg.det(model.X_CD[:3, :3]) > 0.0
    np.testing.assert_array_equal(model.X_CD[3], [0, 0, 0, 1])


def test_pictures_have_the_size_of_the_model(scene: Scene) -> None:
    with scene.camera as camera:
        model = camera.model()
        assert fits(camera.snapshot(), model)
        shown = film(scene)
        assert shown
        assert all(fits(frame, model) for frame in shown)


def test_a_recording_is_in_order_of_time_at_the_cameras_rate(scene: Scene) -> None:
    with scene.camera:
        times_s = np.array([frame.t_s for frame in film(scene)])
    periods = np.diff(times_s) * scene.rate_hz
    assert len(periods) >= 3
    assert (periods > 0.9).all()
    np.testing.assert_allclose(periods, np.round(periods), atol=0.1)  # dropped frames leave whole gaps


def test_its_newest_picture_is_there_at_any_time_and_a_recording_goes_on(scene: Scene) -> None:
    assert scene.camera.newest() is None, "not connected"
    with scene.camera as camera:
        model = camera.model()
        first = camera.snapshot()
        np.testing.assert_array_equal(camera.newest(), first.colour)
        camera.start_recording()
        scene.passes()
        newest = camera.newest()
        assert newest is None or newest.shape == (model.colour.height, model.colour.width, 3)
        assert len(camera.stop_recording()) >= 3
        assert camera.newest() is not None


def test_recordings_follow_one_another(scene: Scene) -> None:
    with scene.camera:
        first, second = film(scene), film(scene)
    assert first[-1].t_s < second[0].t_s


def test_recording_out_of_turn_is_refused(scene: Scene) -> None:
    with scene.camera as camera:
        with pytest.raises(CameraError, match="not recording: call start_recording first"):
            camera.stop_recording()
        camera.start_recording()
        with pytest.raises(CameraError, match="recording already: call stop_recording first"):
            camera.start_recording()
        scene.passes()
        assert camera.stop_recording()  # the refusal did not end it
        with pytest.raises(CameraError, match="not recording"):
            camera.stop_recording()


def test_leaving_ends_a_recording(scene: Scene) -> None:
    with scene.camera as camera:
        camera.start_recording()
    with camera:
        with pytest.raises(CameraError, match="not recording"):
            camera.stop_recording()
        assert film(scene)


@pytest.mark.parametrize("make", over(*SPOILT))
def test_a_recording_that_failed_is_over_and_the_next_one_is_fine(make: Callable[[], Scene]) -> None:
    scene = make()
    assert scene.spoil is not None
    with scene.camera as camera:
        scene.spoil()
        with pytest.raises(CameraError):
            film(scene)
        with pytest.raises(CameraError, match="not recording"):
            camera.stop_recording()
        assert film(scene)


def test_a_snapshot_is_of_now_on_the_arms_clock(scene: Scene) -> None:
    with scene.camera as camera:
        for _ in range(2):
            before_s = scene.now_s()
            frame = camera.snapshot()
            assert before_s - ROUNDING_S <= frame.t_s <= scene.now_s() + ROUNDING_S
            scene.passes()


def test_a_recording_lies_between_its_start_and_its_end_on_the_arms_clock(scene: Scene) -> None:
    with scene.camera:
        before_s = scene.now_s()
        times_s = [frame.t_s for frame in film(scene)]
        after_s = scene.now_s()
    assert before_s - ROUNDING_S <= times_s[0]
    assert times_s[-1] <= after_s + ROUNDING_S
    assert times_s[-1] - times_s[0] > 0.4 * (after_s - before_s)  # a lab's arm settles unfilmed
