"""The messages of a recording: values as ROS 2 types in CDR, and what each topic holds."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from hw.collision import HAND_MASS
from hw.dynamics import torque_Nm
from hw.kinematics import FLANGE, link_poses
from hw.types import Array, CameraModel, Execution, Intrinsics
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

SCHEMAS = {
    "sensor_msgs/msg/CompressedImage": f"{_HEADER}string format\nuint8[] data\n{_STAMP}",
    "sensor_msgs/msg/JointState": f"{_HEADER}string[] name\nfloat64[] position\nfloat64[] velocity\n"
    f"float64[] effort\n{_STAMP}",
    "sensor_msgs/msg/Image": f"{_HEADER}uint32 height\nuint32 width\nstring encoding\nuint8 is_bigendian\n"
    f"uint32 step\nuint8[] data\n{_STAMP}",
    "sensor_msgs/msg/CameraInfo": f"{_HEADER}uint32 height\nuint32 width\nstring distortion_model\nfloat64[] d\n"
    "float64[9] k\nfloat64[9] r\nfloat64[12] p\nuint32 binning_x\nuint32 binning_y\n"
    f"sensor_msgs/RegionOfInterest roi\n{_SEPARATOR}\nMSG: sensor_msgs/RegionOfInterest\nuint32 x_offset\n"
    f"uint32 y_offset\nuint32 height\nuint32 width\nbool do_rectify\n{_STAMP}",
    "std_msgs/msg/String": "string data\n",
    "rcl_interfaces/msg/Log": "builtin_interfaces/Time stamp\nuint8 level\nstring name\nstring msg\nstring file\n"
    f"string function\nuint32 line\n{_SEPARATOR}\n{_TIME}",
    "geometry_msgs/msg/PointStamped": f"{_HEADER}geometry_msgs/Point point\n{_STAMP}"
    f"{_SEPARATOR}\nMSG: geometry_msgs/Point\nfloat64 x\nfloat64 y\nfloat64 z\n",
    "tf2_msgs/msg/TFMessage": f"geometry_msgs/TransformStamped[] transforms\n{_TRANSFORM}{_STAMP}",
}
"""Message definitions in MCAP's `ros2msg` encoding."""


class Writer:
    """Appends primitives with CDR's alignment, counted from behind the four-byte header."""

    def __init__(self) -> None:
        self._body = bytearray()

    def message(self) -> bytes:
        """The whole message: header and content."""
        return b"\x00\x01\x00\x00" + bytes(self._body)

    def header(self, t_ns: int, frame: str) -> Writer:
        """A std_msgs/Header: the stamp in nanoseconds and the frame."""
        return self.time(t_ns).string(frame)

    def time(self, t_ns: int) -> Writer:
        """A stamp: whole seconds, and nanoseconds."""
        seconds, nanoseconds = divmod(t_ns, 1_000_000_000)
        self._pack("<i", seconds)
        self._pack("<I", nanoseconds)
        return self

    def byte(self, value: int) -> Writer:
        """One unsigned byte, or a boolean."""
        self._pack("<B", value)
        return self

    def string(self, text: str) -> Writer:
        """A string with its length and its closing zero."""
        encoded = text.encode() + b"\x00"
        self._pack("<I", len(encoded))
        self._body += encoded
        return self

    def strings(self, texts: Sequence[str]) -> Writer:
        """A sequence of strings."""
        self._pack("<I", len(texts))
        for text in texts:
            self.string(text)
        return self

    def blob(self, content: bytes) -> Writer:
        """A sequence of bytes."""
        self._pack("<I", len(content))
        self._body += content
        return self

    def doubles(self, values: Sequence[float], *, counted: bool) -> Writer:
        """float64 values; if `counted`, their number comes first (a sequence instead of fields)."""
        if counted:
            self._pack("<I", len(values))
        self._body += b"\x00" * (-len(self._body) % 8) if len(values) else b""
        self._body += struct.pack(f"<{len(values)}d", *values)
        return self

    def count(self, n: int) -> Writer:
        """The length of a sequence whose elements follow."""
        self._pack("<I", n)
        return self

    def _pack(self, layout: str, value: float) -> None:
        size = struct.calcsize(layout)
        self._body += b"\x00" * (-len(self._body) % size)
        self._body += struct.pack(layout, value)


def compressed_image(t_ns: int, frame: str, layout: str, content: bytes) -> bytes:
    """A ROS 2 CompressedImage; `layout` is its format, such as "jpeg"."""
    return Writer().header(t_ns, frame).string(layout).blob(content).message()


def image(t_ns: int, frame: str, depth_mm: NDArray[np.uint16]) -> bytes:
    """A ROS 2 Image of encoding 16UC1: (H, W) in mm, as it is."""
    height, width = depth_mm.shape
    writer = Writer().header(t_ns, frame).count(height).count(width).string("16UC1").byte(0).count(2 * width)
    return writer.blob(np.ascontiguousarray(depth_mm, "<u2").tobytes()).message()


def camera_info(t_ns: int, frame: str, camera: Intrinsics) -> bytes:
    """A ROS 2 CameraInfo with OpenCV's eight coefficients."""
    writer = Writer().header(t_ns, frame).count(camera.height).count(camera.width).string("rational_polynomial")
    writer.doubles(camera.distortion.tolist(), counted=True).doubles(camera.K.ravel().tolist(), counted=False)
    writer.doubles(np.eye(3).ravel().tolist(), counted=False)
    writer.doubles(np.column_stack([camera.K, np.zeros(3)]).ravel().tolist(), counted=False)
    return writer.count(0).count(0).count(0).count(0).count(0).count(0).byte(0).message()


def text(content: str) -> bytes:
    """A ROS 2 String."""
    return Writer().string(content).message()


def log(t_ns: int, level: int, name: str, content: str) -> bytes:
    """A ROS 2 Log line; level 20 informs, 30 warns."""
    return Writer().time(t_ns).byte(level).string(name).string(content).string("").string("").count(0).message()


def joint_state(
    t_ns: int,
    names: Sequence[str],
    position: Sequence[float],
    velocity: Sequence[float] = (),
    effort: Sequence[float] = (),
) -> bytes:
    """A ROS 2 JointState: rad, rad/s and N m; unknown fields stay empty."""
    writer = Writer().header(t_ns, "").strings(names).doubles(position, counted=True)
    return writer.doubles(velocity, counted=True).doubles(effort, counted=True).message()


def point(t_ns: int, frame: str, xyz: Sequence[float]) -> bytes:
    """A ROS 2 PointStamped; `xyz` in metres in `frame`."""
    return Writer().header(t_ns, frame).doubles(xyz, counted=False).message()


def transform(t_ns: int, parent: str, child: str, xyz: Sequence[float], xyzw: Sequence[float]) -> bytes:
    """A ROS 2 TFMessage with one pose of `child` in `parent`: metres and a unit quaternion."""
    writer = Writer().count(1).header(t_ns, parent).string(child)
    return writer.doubles(xyz, counted=False).doubles(xyzw, counted=False).message()


class Reader:
    """Reads the messages of `Writer`, field by field. Raises struct.error or IndexError if the message is truncated."""

    def __init__(self, message: bytes) -> None:
        self._body = memoryview(message)[4:]
        self._at = 0

    def header(self) -> tuple[int, str]:
        """(time in ns, frame)."""
        t_ns = int(self._unpack("<i")) * 1_000_000_000 + int(self._unpack("<I"))
        return t_ns, self.string()

    def count(self) -> int:
        """The length of the sequence that follows."""
        return int(self._unpack("<I"))

    def string(self) -> str:
        """The next string."""
        return bytes(self.blob()[:-1]).decode()

    def strings(self) -> tuple[str, ...]:
        """The next sequence of strings."""
        return tuple(self.string() for _ in range(self.count()))

    def blob(self) -> memoryview:
        """The next sequence of bytes; a view, not a copy."""
        size = self.count()
        content = self._body[self._at : self._at + size]
        if len(content) < size:
            raise IndexError("a field runs past the end of its message")
        self._at += size
        return content

    def doubles(self, n: int | None = None) -> tuple[float, ...]:
        """`n` float64 fields, or a counted sequence of them."""
        size = self.count() if n is None else n
        return tuple(self._unpack("<d") for _ in range(size))

    def byte(self) -> int:
        """One unsigned byte."""
        return int(self._unpack("<B"))

    def _unpack(self, layout: str) -> float:
        size = struct.calcsize(layout)
        self._at += -self._at % size
        value: float = struct.unpack_from(layout, self._body, self._at)[0]
        self._at += size
        return value


Message = tuple[int, str, bytes]
"""Time in ns, topic, content in CDR."""

COLOUR_INFO, DEPTH_INFO = "/camera/colour/camera_info", "/camera/depth/camera_info"
MEASURED, COMMANDED = "/joints/measured", "/joints/commanded"
DESCRIPTION, TRANSFORMS, EVENTS, OUTCOME, OBJECT = "/robot_description", "/tf", "/events", "/outcome", "/object"
TYPES = {
    COLOUR_INFO: "sensor_msgs/msg/CameraInfo",
    DEPTH_INFO: "sensor_msgs/msg/CameraInfo",
    MEASURED: "sensor_msgs/msg/JointState",
    COMMANDED: "sensor_msgs/msg/JointState",
    DESCRIPTION: "std_msgs/msg/String",
    TRANSFORMS: "tf2_msgs/msg/TFMessage",
}
"""Topics of every recording."""
AFTERWARDS = {
    EVENTS: "rcl_interfaces/msg/Log",
    OUTCOME: "std_msgs/msg/String",
    OBJECT: "geometry_msgs/msg/PointStamped",
}
"""Topics that are known only after a trial was judged."""

SMOOTHED_S = 0.05
"""Window for the derivatives of measured joints, by a fitted cubic (Savitzky and Golay, 1964)."""

FRAMES = (*(f"panda_link{i}" for i in range(8)), FLANGE_NAME, HAND_NAME)
"""The arm's frames: those of `hw.kinematics.link_poses`, and the hand."""

X_FH = np.eye(4)
"""The hand in the flange: rotated by 45° about Z (hw.kinematics)."""
X_FH[:3, :3] = Rotation.from_euler("z", -np.pi / 4).as_matrix()


def cameras(model: CameraModel, t_ns: int) -> Iterator[Message]:
    """Both cameras' intrinsics, once."""
    yield t_ns, COLOUR_INFO, camera_info(t_ns, "camera_colour", model.colour)
    yield t_ns, DEPTH_INFO, camera_info(t_ns, "camera_depth", model.depth)


def description(arm: str, t_ns: int) -> Message:
    """The arm as URDF."""
    return t_ns, DESCRIPTION, text(urdf(arm))


def joints(arm: str, played: Execution) -> Iterator[Message]:
    """Measured and commanded joints, each with velocity and the torque of the motion.

    Velocities are derivatives of the positions. Torques are those of the rigid-body model of `arm` with its
    hand ("panda" or "fr3"), for the measured motion in the air; the tool's weight and its contacts are not included.
    """
    if not len(played.t_s):
        return
    dq_rad_s, ddq_rad_s2 = (derivative(played.t_s, played.q_measured_rad, order) for order in (1, 2))
    commanded_rad_s = derivative(played.t_s, played.q_commanded_rad, 1)
    torque = torque_Nm(arm, played.q_measured_rad, dq_rad_s, ddq_rad_s2, HAND_MASS.placed(X_FH))
    for i, t_s in enumerate(played.t_s):
        t_ns = ns(played.t_start_s + t_s)
        yield t_ns, MEASURED, joint_state(t_ns, JOINT_NAMES, played.q_measured_rad[i], dq_rad_s[i], torque[i])
        yield t_ns, COMMANDED, joint_state(t_ns, JOINT_NAMES, played.q_commanded_rad[i], commanded_rad_s[i], ())


def joints_at(played: Execution) -> Callable[[float], Array]:
    """Arm clock -> measured joints (7,), held beyond the ends."""

    def q_at(t_s: float) -> Array:
        since_s = t_s - played.t_start_s
        return np.array([np.interp(since_s, played.t_s, joint) for joint in played.q_measured_rad.T])

    return q_at


def link_frames(q_rad: Array) -> Iterator[tuple[str, Array]]:
    """Every one of `FRAMES` with its pose (4, 4) in the base, for joints (7,)."""
    poses = link_poses(q_rad)
    return zip(FRAMES, (*poses, poses[FLANGE] @ X_FH), strict=True)


def transforms(
    times_s: Sequence[float], played: Execution, X_BT_at: Callable[[float], Array], model: CameraModel, X_BC: Array
) -> Iterator[Message]:
    """Base to tool and to every link at each image, from the measured joints; base to both cameras once."""
    q_at = joints_at(played)
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
    t_ns, xyzw = ns(t_s), Rotation.from_matrix(X[:3, :3]).as_quat().tolist()
    return t_ns, TRANSFORMS, transform(t_ns, parent, child, X[:3, 3].tolist(), xyzw)


def ns(t_s: float) -> int:
    """Seconds on the arm's clock as the whole nanoseconds of a stamp."""
    return round(t_s * 1e9)
