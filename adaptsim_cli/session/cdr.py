"""The few ROS 2 messages that recordings hold, written as Common Data Representation (OMG CDR, little endian).

Foxglove, Rerun and ROS 2 read these without any plug-in, and images stay binary.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

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


def camera_info(
    t_ns: int, frame: str, size: tuple[int, int], K: NDArray[np.float64], distortion: NDArray[np.float64]
) -> bytes:
    """A ROS 2 CameraInfo of a camera of `size` (width, height), with OpenCV's eight coefficients."""
    width, height = size
    writer = Writer().header(t_ns, frame).count(height).count(width).string("rational_polynomial")
    writer.doubles(distortion.tolist(), counted=True).doubles(K.ravel().tolist(), counted=False)
    writer.doubles(np.eye(3).ravel().tolist(), counted=False)
    writer.doubles(np.column_stack([K, np.zeros(3)]).ravel().tolist(), counted=False)
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
