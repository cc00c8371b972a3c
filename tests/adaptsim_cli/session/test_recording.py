"""The recording of a trial and its film hold every picture as the tracker saw it."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from mcap.reader import make_reader
from toy_rig import MODEL, X_BC

from adaptsim_cli.bench.rig import Recording
from adaptsim_cli.errors import SessionError
from adaptsim_cli.session import recording, topics
from adaptsim_cli.session.film import COLUMNS, MOST_BYTES, ROWS, Filmed
from adaptsim_cli.session.folders import FILM
from adaptsim_cli.session.store import SessionStore
from hw.bounded import decode_image
from hw.poses import inverse
from hw.quantities import QUANTITIES, MeasuredQuantity
from hw.types import Execution, Frame
from perception.geometry import project
from perception.types import ObjectTrack, Outcome


def frames() -> list[Frame]:
    rng = np.random.default_rng(0)
    v, u = np.mgrid[:48, :64]
    smooth = np.stack([3 * u, 4 * v, 128 + 0 * u], axis=-1).astype(np.uint8)
    return [Frame(12.0 + k / 30, smooth, rng.integers(0, 2000, (48, 64), np.uint16)) for k in range(4)]


def before() -> Frame:
    colour = np.random.default_rng(1).integers(0, 256, (48, 64, 3), np.uint8)
    return Frame(11.5, colour, np.full((48, 64), 700, np.uint16))


def execution() -> Execution:
    t_s = np.linspace(0.0, 0.119, 120)
    q = np.outer(np.linspace(0.0, 1.0, 120), np.arange(1.0, 8.0))
    return Execution(12.0, t_s, q, q + 1e-3, 0.98)


EVERY = [quantity.name for quantity in QUANTITIES]


def measuring(names: Sequence[str] = tuple(EVERY)) -> Execution:
    """An execution with quantities that the arm reported."""
    rng, played = np.random.default_rng(3), execution()
    sizes = {quantity.name: quantity.size for quantity in QUANTITIES}
    return dataclasses.replace(
        played, measured={name: rng.normal(size=(len(played.t_s), sizes[name])) for name in names}
    )


def encoded(played: Execution, after: Frame | None = None) -> tuple[bytes, Recording]:
    film, first = [recording.stored(frame) for frame in frames()], recording.stored(before(), lossless=True)
    home = None if after is None else recording.stored(after, lossless=True)
    return recording.begin(first, film, MODEL, X_BC, played, lambda _: np.eye(4), 0.0123456789).finish(home)


@pytest.fixture
def file(tmp_path) -> Path:
    path = tmp_path / recording.FILE
    path.write_bytes(encoded(execution())[0])
    return path


def content(value: object) -> object:
    """Everything in a value, comparable bit for bit."""
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.shape, value.tobytes()
    if dataclasses.is_dataclass(value):
        return [content(getattr(value, field.name)) for field in dataclasses.fields(value)]
    return [content(one) for one in value] if isinstance(value, tuple) else value


def uneven() -> Execution:
    """Times that no clock of nanoseconds holds exactly."""
    t_s = np.arange(50) / 997.0
    q = np.random.default_rng(2).normal(size=(50, 7))
    return Execution(12.0 + 1 / 3, t_s, q, q + 1e-3, 2 / 3)


@pytest.mark.parametrize("is_carried", [False, True])
def test_the_tracker_sees_the_same_before_and_after_the_disk_bit_for_bit(tmp_path, *, is_carried):
    after = Frame(before().t_s + 30.1, before().colour[::-1].copy(), before().depth_mm) if is_carried else None
    path = tmp_path / recording.FILE
    written, in_memory = encoded(uneven(), after)
    path.write_bytes(written)
    back = recording.read(path)
    assert content(back) == content(in_memory)
    assert (back.after is not None) == is_carried


def test_what_was_recorded_can_be_tracked_again(file):
    back = recording.read(file)
    for old, new in zip(frames(), back.frames, strict=True):
        assert new.t_s == pytest.approx(old.t_s, abs=1e-8)
        assert np.array_equal(new.depth_mm, old.depth_mm), "depth is lossless"
        assert np.abs(new.colour.astype(int) - old.colour).mean() < 2, "colour as good as JPEG keeps it"
    assert np.array_equal(back.before.depth_mm, before().depth_mm)
    assert np.array_equal(back.before.colour, before().colour), "the object is found again in the same pixels"
    assert back.before.t_s == pytest.approx(11.5)
    assert np.array_equal(back.X_BC, X_BC)
    assert np.array_equal(back.model.colour.K, MODEL.colour.K)
    assert back.model.serial == MODEL.serial
    assert np.array_equal(back.execution.q_measured_rad, execution().q_measured_rad)
    assert np.array_equal(back.execution.q_commanded_rad, execution().q_commanded_rad)
    assert np.allclose(back.execution.t_s, execution().t_s, atol=1e-8)
    assert (back.execution.t_start_s, back.execution.control_success_rate) == (12.0, 0.98)


def test_other_tools_find_standard_messages_in_order_of_time(file):
    with file.open("rb") as stream:
        reader = make_reader(stream)
        assert reader.get_header().profile == "ros2"
        found = [(s.name, s.encoding, c.topic, m.log_time) for s, c, m in reader.iter_messages(log_time_order=False)]
    assert {(name, topic) for name, _, topic, _ in found} == {
        ("sensor_msgs/msg/CompressedImage", "/camera/colour"),
        ("sensor_msgs/msg/Image", "/camera/depth"),
        ("sensor_msgs/msg/CameraInfo", "/camera/colour/camera_info"),
        ("sensor_msgs/msg/CameraInfo", "/camera/depth/camera_info"),
        ("std_msgs/msg/String", "/robot_description"),
        ("sensor_msgs/msg/CompressedImage", "/before/colour"),
        ("sensor_msgs/msg/Image", "/before/depth"),
        ("sensor_msgs/msg/JointState", "/joints/measured"),
        ("sensor_msgs/msg/JointState", "/joints/commanded"),
        ("tf2_msgs/msg/TFMessage", "/tf"),
    }
    assert {encoding for _, encoding, _, _ in found} == {"ros2msg"}
    times = [t for *_, t in found]
    assert times == sorted(times)


def test_the_track_is_a_file_of_its_own_on_the_same_clock(tmp_path):
    track = ObjectTrack(np.array([0.0, 0.1]), np.eye(2, 3), Outcome.ON_BLADE, np.zeros(3), np.ones(2))
    path = tmp_path / recording.OBJECT_FILE
    path.write_bytes(recording.encode_object(track, 12.0))
    with path.open("rb") as stream:
        found = [(c.topic, m.log_time, m.data) for _, c, m in make_reader(stream).iter_messages()]
    assert [(topic, t_ns) for topic, t_ns, _ in found] == [("/object", 12_000_000_000), ("/object", 12_100_000_000)]
    fields = topics.decode(topics.POINT, found[1][2])
    assert (topics.stamp_ns(fields.header), fields.header.frame_id) == (12_100_000_000, "base")
    assert (fields.point.x, fields.point.y, fields.point.z) == (0.0, 1.0, 0.0)


@pytest.mark.parametrize("cut", [0.0, 0.3, 0.999, None])
def test_a_truncated_or_damaged_recording_is_named(file, cut):
    content = bytearray(file.read_bytes())
    if cut is None:
        start = content.index(b"\x28\xb5\x2f\xfd")  # a compressed block
        content[start + 20 : start + 40] = bytes(20)
    else:
        content = content[: int(len(content) * cut)]
    file.write_bytes(content)
    with pytest.raises(SessionError, match=r"recording.mcap is corrupt"):
        recording.read(file)


@pytest.mark.parametrize("length", [1 << 62, 1 << 63])
def test_a_length_beyond_all_memory_is_named(file, length):
    content = file.read_bytes()
    at = content.index(b"application/json") + len(b"application/json")
    file.write_bytes(content[:at] + length.to_bytes(8, "little") + content[at + 8 :])
    with pytest.raises(SessionError, match=r"recording.mcap is corrupt"):
        recording.read(file)


def test_the_same_trial_gives_the_same_bytes():
    assert encoded(execution())[0] == encoded(execution())[0]


def test_messages_are_laid_out_as_cdr_wants_them() -> None:
    # Header (stamp 1.000000002 s, frame "ab"), then x = 1.5 aligned to eight bytes behind the four-byte header.
    expected = bytes.fromhex("00010000 01000000 02000000 03000000 616200 00 000000000000f83f".replace(" ", ""))
    assert topics.point(1_000_000_002, "ab", (1.5, 0.0, 0.0)) == expected + bytes(16)
    back = topics.decode(topics.POINT, expected + bytes(16))
    assert (topics.stamp_ns(back.header), back.header.frame_id, back.point.x) == (1_000_000_002, "ab", 1.5)


@pytest.fixture
def filmed(undisturbed: SessionStore) -> Filmed:
    store = undisturbed
    record = store.trials(0)[0]
    stored = recording.read(store.trial_folder(*record.position) / recording.FILE)
    track, start_s = record.track.track(), stored.execution.t_start_s
    return Filmed(stored.frames, stored.model, stored.X_BC, start_s, track, track.state[0, :2], None)


def test_every_trial_has_its_film(undisturbed):
    for record in undisturbed.trials(0):
        sheet = decode_image((undisturbed.trial_folder(*record.position) / FILM).read_bytes(), cv2.IMREAD_COLOR)
        assert sheet.shape == (ROWS * 240, COLUMNS * 240, 3)
        assert record.film is not None and record.film.end_s == record.track.t_s[-1]
        assert FILM in record.checksums


def test_what_is_drawn_over_the_film_lies_where_the_camera_sees_it(filmed):
    film, _ = filmed.sheet()
    left, top, right, bottom = filmed._window(with_goal=True)
    p_m = filmed.track.state[:, :3]
    u, v, w = np.array(film.camera).reshape(3, 4) @ np.column_stack([p_m, np.ones(len(p_m))]).T
    seen = project(filmed.model.colour, inverse(filmed.X_BC), p_m)
    wanted = (seen - [left, top]) / [right - left, bottom - top]
    assert np.abs(np.column_stack([u / w, v / w]) - wanted).max() < 1 / 240


def test_a_goal_beside_the_path_is_in_the_picture(filmed):
    goal_m = filmed.track.state[-1, :2] + [0.0, 0.01]
    film, _ = replace(filmed, goal_m=goal_m).sheet()
    u, v, w = np.array(film.camera).reshape(3, 4) @ [*goal_m, 0.0, 1.0]
    assert 0 < u / w < 1 and 0 < v / w < 1


def test_even_noise_fits_a_page(filmed):
    rng = np.random.default_rng(0)
    frames = [replace(f, colour=rng.integers(0, 256, f.colour.shape, np.uint8)) for f in filmed.frames]
    _, files = replace(filmed, frames=frames).sheet()
    assert len(files[FILM]) <= MOST_BYTES


@pytest.mark.parametrize("names", [[], ["joint_torque_Nm"], ["external_wrench"], [q.name for q in QUANTITIES]])
def test_what_the_arm_measured_is_kept_bit_for_bit_and_nothing_else(tmp_path, names):
    path = tmp_path / recording.FILE
    path.write_bytes(encoded(measuring(names))[0])
    back = recording.read(path).execution
    assert set(back.measured) == set(names)
    for name in names:
        assert np.array_equal(back.measured[name], measuring(names).measured[name])
    with path.open("rb") as stream:
        states = {
            channel.topic: topics.decode(topics.JOINTS, message.data)
            for _, channel, message in make_reader(stream).iter_messages(topics=[topics.MEASURED, "/joints/external"])
        }
    assert len(states[topics.MEASURED].effort) == (7 if "joint_torque_Nm" in names else 0), "never a modelled one"
    assert ("/joints/external" in states) == ("external_torque_Nm" in names)


def test_an_older_recordings_modelled_effort_is_not_taken_for_a_measured_one(tmp_path, monkeypatch):
    """Its camera.json does not say what was measured, and `effort` was computed."""
    whole = recording._camera_json

    def older(*values):
        content = json.loads(whole(*values))
        del content["measured"]
        return json.dumps(content).encode()

    monkeypatch.setattr(recording, "_camera_json", older)
    path = tmp_path / recording.FILE
    path.write_bytes(encoded(measuring(["joint_torque_Nm"]))[0])
    back = recording.read(path)
    assert back.execution.measured == {}
    assert np.array_equal(back.execution.q_measured_rad, execution().q_measured_rad)


def test_a_quantity_of_a_newer_version_is_left_out_and_the_recording_opens(tmp_path, monkeypatch):
    newer = MeasuredQuantity("motor_position_rad", "theta", ("a",) * 7, "/joints/motor", "position", "of the motors")
    types_of, reported = topics.quantity_types, topics.reported
    monkeypatch.setattr(topics, "QUANTITIES", (*QUANTITIES, newer))
    monkeypatch.setattr("hw.types.QUANTITIES", (*QUANTITIES, newer))
    assert types_of(["motor_position_rad"]) == {"/joints/motor": topics.JOINTS}
    assert reported(["motor_position_rad"]) == (newer,)
    path = tmp_path / recording.FILE
    q_rad = execution().q_measured_rad
    played = dataclasses.replace(measuring(), measured={**measuring().measured, "motor_position_rad": 2.0 * q_rad})
    path.write_bytes(encoded(played)[0])
    assert np.array_equal(recording.read(path).execution.measured["motor_position_rad"], 2.0 * q_rad)
    monkeypatch.undo()
    assert set(recording.read(path).execution.measured) == {quantity.name for quantity in QUANTITIES}
