"""The messages of a recording: values as ROS 2 types in CDR, and the content of each topic."""

from __future__ import annotations

import json
from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np
from mcap_ros2._dynamic import generate_dynamic, serialize_dynamic  # its public writer makes whole files only
from numpy.typing import NDArray

from hw.kinematics import FLANGE, link_poses
from hw.quantities import QUANTITIES, MeasuredQuantity
from hw.types import Array, CameraModel, Execution, Intrinsics
from hw.wrist import X_FH
from sim.panda.model import FLANGE_NAME, HAND_NAME, JOINT_NAMES, urdf

_HEADER = "std_msgs/Header header\n"
_SEPARATOR = "=" * 80
_TIME = "MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
_STAMP = f"{_SEPARATOR}\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n{_SEPARATOR}\n{_TIME}"
_TRANSFORM = "\n".join(
    (
        _SEPARATOR,
        "MSG: geometry_msgs/TransformStamped\nstd_msgs/Header header\nstring child_frame_id",
        "geometry_msgs/Transform transform",
        _SEPARATOR,
        "MSG: geometry_msgs/Transform\ngeometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation",
        _SEPARATOR,
        "MSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z",
        _SEPARATOR,
        "MSG: geometry_msgs/Quaternion\nfloat64 x\nfloat64 y\nfloat64 z\nfloat64 w\n",
    )
)

PICTURE, DEPTH = "sensor_msgs/msg/CompressedImage", "sensor_msgs/msg/Image"
WRENCH = "geometry_msgs/msg/WrenchStamped"
JOINTS, TRANSFORM, POINT = "sensor_msgs/msg/JointState", "tf2_msgs/msg/TFMessage", "geometry_msgs/msg/PointStamped"
SCHEMAS = {
    PICTURE: f"{_HEADER}string format\nuint8[] data\n{_STAMP}",
    JOINTS: f"{_HEADER}string[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n{_STAMP}",
    DEPTH: f"{_HEADER}uint32 height\nuint32 width\nstring encoding\nuint8 is_bigendian\n"
    f"uint32 step\nuint8[] data\n{_STAMP}",
    "sensor_msgs/msg/CameraInfo": f"{_HEADER}uint32 height\nuint32 width\nstring distortion_model\nfloat64[] d\n"
    "float64[9] k\nfloat64[9] r\nfloat64[12] p\nuint32 binning_x\nuint32 binning_y\n"
    f"sensor_msgs/RegionOfInterest roi\n{_SEPARATOR}\nMSG: sensor_msgs/RegionOfInterest\nuint32 x_offset\n"
    f"uint32 y_offset\nuint32 height\nuint32 width\nbool do_rectify\n{_STAMP}",
    "std_msgs/msg/String": "string data\n",
    "rcl_interfaces/msg/Log": "builtin_interfaces/Time stamp\nuint8 level\nstring name\nstring msg\nstring file\n"
    f"string function\nuint32 line\n{_SEPARATOR}\n{_TIME}",
    POINT: f"{_HEADER}geometry_msgs/Point point\n{_STAMP}"
    f"{_SEPARATOR}\nMSG: geometry_msgs/Point\nfloat64 x\nfloat64 y\nfloat64 z\n",
    WRENCH: f"{_HEADER}geometry_msgs/Wrench wrench\n{_STAMP}{_SEPARATOR}\nMSG: geometry_msgs/Wrench\n"
    f"geometry_msgs/Vector3 force\ngeometry_msgs/Vector3 torque\n{_SEPARATOR}\nMSG: geometry_msgs/Vector3\n"
    "float64 x\nfloat64 y\nfloat64 z\n",
    TRANSFORM: f"geometry_msgs/TransformStamped[] transforms\n{_TRANSFORM}{_STAMP}",
}
"""Message definitions in MCAP's `ros2msg` encoding."""


def encode(kind: str, fields: Mapping[str, Any]) -> bytes:
    """The message of type `kind` in CDR; fields that are left out are zero or empty."""
    return bytes(_encoder(kind)(fields))


def decode(kind: str, message: bytes) -> Any:
    """The fields of a message of type `kind`, as attributes. Raises one of `mcap_errors.DAMAGED` if it is truncated."""
    return _decoder(kind)(message)


@cache
def _encoder(kind: str) -> Callable[[Mapping[str, Any]], bytes]:
    encoder: Callable[[Mapping[str, Any]], bytes] = serialize_dynamic(kind, SCHEMAS[kind])[kind]
    return encoder


@cache
def _decoder(kind: str) -> Callable[[bytes], Any]:
    decoder: Callable[[bytes], Any] = generate_dynamic(kind, SCHEMAS[kind])[kind]
    return decoder


def stamp_ns(header: Any) -> int:
    """The time of a decoded std_msgs/Header."""
    return int(header.stamp.sec) * 1_000_000_000 + int(header.stamp.nanosec)


def _stamp(t_ns: int) -> dict[str, int]:
    seconds, nanoseconds = divmod(t_ns, 1_000_000_000)
    return {"sec": seconds, "nanosec": nanoseconds}


def _header(t_ns: int, frame: str) -> dict[str, Any]:
    return {"stamp": _stamp(t_ns), "frame_id": frame}


def compressed_image(t_ns: int, frame: str, layout: str, content: bytes) -> bytes:
    """A ROS 2 CompressedImage; `layout` is its format, such as "jpeg"."""
    return encode(PICTURE, {"header": _header(t_ns, frame), "format": layout, "data": content})


def image(t_ns: int, frame: str, depth_mm: NDArray[np.uint16]) -> bytes:
    """A ROS 2 Image of encoding 16UC1: (H, W) in mm, as it is."""
    height, width = depth_mm.shape
    pixels = np.ascontiguousarray(depth_mm, "<u2").tobytes()
    size = {"height": height, "width": width, "encoding": "16UC1", "step": 2 * width}
    return encode(DEPTH, {"header": _header(t_ns, frame), **size, "data": pixels})


def camera_info(t_ns: int, frame: str, camera: Intrinsics) -> bytes:
    """A ROS 2 CameraInfo with OpenCV's eight coefficients."""
    fields = {
        "header": _header(t_ns, frame),
        "height": camera.height,
        "width": camera.width,
        "distortion_model": "rational_polynomial",
        "d": camera.distortion.tolist(),
        "k": camera.K.ravel().tolist(),
        "r": np.eye(3).ravel().tolist(),
        "p": np.column_stack([camera.K, np.zeros(3)]).ravel().tolist(),
    }
    return encode("sensor_msgs/msg/CameraInfo", fields)


def text(content: str) -> bytes:
    """A ROS 2 String."""
    return encode("std_msgs/msg/String", {"data": content})


def log(t_ns: int, level: int, name: str, content: str) -> bytes:
    """A ROS 2 Log line; level 20 informs, 30 warns."""
    return encode("rcl_interfaces/msg/Log", {"stamp": _stamp(t_ns), "level": level, "name": name, "msg": content})


def joint_state(
    t_ns: int,
    names: Sequence[str],
    position: Sequence[float],
    velocity: Sequence[float] = (),
    effort: Sequence[float] = (),
) -> bytes:
    """A ROS 2 JointState: rad, rad/s and N m; unknown fields stay empty."""
    values = {"position": list(position), "velocity": list(velocity), "effort": list(effort)}
    return encode(JOINTS, {"header": _header(t_ns, ""), "name": list(names), **values})


def wrench(t_ns: int, frame: str, values: Sequence[float]) -> bytes:
    """A ROS 2 WrenchStamped: force (N) and torque (Nm), three values each, in `frame`."""
    parts = {"force": dict(zip("xyz", values[:3], strict=True)), "torque": dict(zip("xyz", values[3:], strict=True))}
    return encode(WRENCH, {"header": _header(t_ns, frame), "wrench": parts})


def point(t_ns: int, frame: str, xyz: Sequence[float]) -> bytes:
    """A ROS 2 PointStamped; `xyz` in metres in `frame`."""
    return encode(POINT, {"header": _header(t_ns, frame), "point": dict(zip("xyz", xyz, strict=True))})


def transform(t_ns: int, parent: str, child: str, xyz: Sequence[float], xyzw: Sequence[float]) -> bytes:
    """A ROS 2 TFMessage with one pose of `child` in `parent`: metres and a unit quaternion."""
    pose = {"translation": dict(zip("xyz", xyz, strict=True)), "rotation": dict(zip("xyzw", xyzw, strict=True))}
    return encode(
        TRANSFORM, {"transforms": [{"header": _header(t_ns, parent), "child_frame_id": child, "transform": pose}]}
    )


Message = tuple[int, str, bytes]
"""Time in ns, topic, content in CDR."""

COLOUR_INFO, DEPTH_INFO = "/camera/colour/camera_info", "/camera/depth/camera_info"
MEASURED, COMMANDED = "/joints/measured", "/joints/commanded"
DESCRIPTION, TRANSFORMS, EVENTS, OUTCOME, OBJECT = "/robot_description", "/tf", "/events", "/outcome", "/object"
TYPES = {
    COLOUR_INFO: "sensor_msgs/msg/CameraInfo",
    DEPTH_INFO: "sensor_msgs/msg/CameraInfo",
    MEASURED: JOINTS,
    COMMANDED: JOINTS,
    DESCRIPTION: "std_msgs/msg/String",
    TRANSFORMS: TRANSFORM,
}
"""Topics of every recording."""
AFTERWARDS = {
    EVENTS: "rcl_interfaces/msg/Log",
    OUTCOME: "std_msgs/msg/String",
    OBJECT: POINT,
}
"""Topics that are known only after a trial was judged."""

SMOOTHED_S = 0.05
"""Window for the derivatives of measured joints, by a fitted cubic (Savitzky and Golay, 1964)."""

FRAMES = (*(f"panda_link{i}" for i in range(8)), FLANGE_NAME, HAND_NAME)
"""The arm's frames: those of `hw.kinematics.link_poses`, and the hand."""


def cameras(model: CameraModel, t_ns: int) -> Iterator[Message]:
    """The intrinsics of both cameras, once."""
    yield t_ns, COLOUR_INFO, camera_info(t_ns, "camera_colour", model.colour)
    yield t_ns, DEPTH_INFO, camera_info(t_ns, "camera_depth", model.depth)


def description(arm: str, t_ns: int) -> Message:
    """The arm as URDF."""
    return t_ns, DESCRIPTION, text(urdf(arm))


def joints(played: Execution) -> Iterator[Message]:
    """Measured and commanded joints, each with its velocity, and every quantity that the arm reported.

    Velocities are derivatives of the positions. Effort is the measured torque; empty if the arm reported none.
    """
    if not len(played.t_s):
        return
    dq_rad_s, commanded_rad_s = (
        derivative(played.t_s, q_rad, 1) for q_rad in (played.q_measured_rad, played.q_commanded_rad)
    )
    logs = [(quantity, played.measured[quantity.name]) for quantity in reported(played.measured)]
    efforts = [log for quantity, log in logs if quantity.topic == MEASURED]
    others = [(quantity, log) for quantity, log in logs if quantity.topic != MEASURED]
    for i, t_s in enumerate(played.t_s):
        t_ns = ns(played.t_start_s + t_s)
        effort = efforts[0][i] if efforts else ()
        yield t_ns, MEASURED, joint_state(t_ns, JOINT_NAMES, played.q_measured_rad[i], dq_rad_s[i], effort)
        yield t_ns, COMMANDED, joint_state(t_ns, JOINT_NAMES, played.q_commanded_rad[i], commanded_rad_s[i], ())
        for quantity, log in others:
            yield t_ns, quantity.topic, _quantity(t_ns, quantity, log[i].tolist())


def reported(names: Container[str]) -> tuple[MeasuredQuantity, ...]:
    """The quantities with these names. Names from newer versions are left out."""
    return tuple(quantity for quantity in QUANTITIES if quantity.name in names)


def quantity_types(names: Container[str]) -> dict[str, str]:
    """Topic -> message type of the quantities with these names."""
    return {quantity.topic: WRENCH if quantity.field == "wrench" else JOINTS for quantity in reported(names)}


def quantity_values(quantity: MeasuredQuantity, message: Any) -> tuple[float, ...]:
    """The values of a quantity in a decoded message of its topic."""
    if quantity.field == "wrench":
        return tuple(getattr(getattr(message.wrench, part), axis) for part in ("force", "torque") for axis in "xyz")
    return tuple(getattr(message, quantity.field))


def _quantity(t_ns: int, quantity: MeasuredQuantity, values: list[float]) -> bytes:
    if quantity.field == "wrench":
        return wrench(t_ns, "base", values)
    fields: dict[str, Sequence[float]] = {"position": (), quantity.field: values}
    return joint_state(t_ns, JOINT_NAMES, **fields)


def link_frames(q_rad: Array) -> Iterator[tuple[str, Array]]:
    """Every one of `FRAMES` with its pose (4, 4) in the base, for joints (7,)."""
    poses = link_poses(q_rad)
    return zip(FRAMES, (*poses, poses[FLANGE] @ X_FH), strict=True)


def transforms(
    times_s: Sequence[float], played: Execution, X_BT_at: Callable[[float], Array], model: CameraModel, X_BC: Array
) -> Iterator[Message]:
    """Base to tool and to every link at each image, from the measured joints; base to both cameras once."""
    q_at = played.q_at
    for t_s in times_s if len(played.t_s) else ():
        yield _transform(t_s, "base", "tool", X_BT_at(t_s))
        for name, X in link_frames(q_at(t_s)):
            yield _transform(t_s, "base", name, X)
    for t_s in times_s[:1]:
        yield _transform(t_s, "base", "camera_colour", X_BC)
        yield _transform(t_s, "camera_colour", "camera_depth", model.X_CD)


def event(t_s: float, text: str, *, is_warning: bool = False) -> Message:
    """One line of the events, at a time on the arm's clock."""
    t_ns = ns(t_s)
    return t_ns, EVENTS, log(t_ns, 30 if is_warning else 20, "adaptsim", text)


def outcome(t_s: float, values: dict[str, object]) -> Message:
    """How a trial ended, as JSON."""
    return ns(t_s), OUTCOME, text(json.dumps(values, allow_nan=False))


def derivative(t_s: Array, values: Array, order: int) -> Array:
    """The derivative (N, ...) of values (N, ...) at evenly spaced times; 0 if there are too few values."""
    if len(t_s) < 5:
        return np.zeros_like(values)
    from scipy.signal import savgol_filter  # slow to import, and only a finished motion needs it

    step_s = float(np.median(np.diff(t_s)))
    odd = 2 * (round(SMOOTHED_S / step_s) // 2) + 1
    window = max(5, min(odd, len(t_s) - 1 + len(t_s) % 2))
    return np.asarray(savgol_filter(values, window, 3, deriv=order, delta=step_s, axis=0))


def _transform(t_s: float, parent: str, child: str, X: Array) -> Message:
    from scipy.spatial.transform import Rotation  # slow to import, and a list of sessions needs no motion

    t_ns, xyzw = ns(t_s), Rotation.from_matrix(X[:3, :3]).as_quat().tolist()
    return t_ns, TRANSFORMS, transform(t_ns, parent, child, X[:3, 3].tolist(), xyzw)


def ns(t_s: float) -> int:
    """Seconds on the arm's clock as the whole nanoseconds of a stamp."""
    return round(t_s * 1e9)
