"""Topics for viewers besides pictures and joints: cameras, transforms, the arm's description, and events.

Messages of a recording, as (time in ns, topic, CDR); pure.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from adaptsim_cli.session import cdr
from hw.collision import HAND_MASS
from hw.dynamics import torque_Nm
from hw.kinematics import FLANGE, link_poses
from hw.types import Array, CameraModel, Execution, Intrinsics
from sim.panda.model import FLANGE_NAME, HAND_NAME, JOINT_NAMES, urdf

Message = tuple[int, str, bytes]

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
    yield t_ns, COLOUR_INFO, _info(t_ns, "camera_colour", model.colour)
    yield t_ns, DEPTH_INFO, _info(t_ns, "camera_depth", model.depth)


def description(arm: str, t_ns: int) -> Message:
    """The arm as URDF."""
    return t_ns, DESCRIPTION, cdr.text(urdf(arm))


def joints(played: Execution) -> Iterator[Message]:
    """Measured and commanded joints, each with velocity and the torque of the motion.

    Velocities are derivatives of the positions. Torques are those of the arm's rigid-body model with its hand, for the
    measured motion in the air; the tool's weight and its contacts are not included.
    """
    if not len(played.t_s):
        return
    dq_rad_s, ddq_rad_s2 = (derivative(played.t_s, played.q_measured_rad, order) for order in (1, 2))
    commanded_rad_s = derivative(played.t_s, played.q_commanded_rad, 1)
    torque = torque_Nm(played.q_measured_rad, dq_rad_s, ddq_rad_s2, HAND_MASS.placed(X_FH))
    for i, t_s in enumerate(played.t_s):
        t_ns = _ns(played.t_start_s + t_s)
        yield t_ns, MEASURED, cdr.joint_state(t_ns, JOINT_NAMES, played.q_measured_rad[i], dq_rad_s[i], torque[i])
        yield t_ns, COMMANDED, cdr.joint_state(t_ns, JOINT_NAMES, played.q_commanded_rad[i], commanded_rad_s[i], ())


def transforms(
    times_s: Sequence[float], played: Execution, X_BT_at: Callable[[float], Array], model: CameraModel, X_BC: Array
) -> Iterator[Message]:
    """Base to tool and to every link at each image, from the measured joints; base to both cameras once."""
    for t_s in times_s if len(played.t_s) else ():
        since_s = t_s - played.t_start_s
        q_rad = np.array([np.interp(since_s, played.t_s, joint) for joint in played.q_measured_rad.T])
        poses = link_poses(q_rad)
        yield _transform(t_s, "base", "tool", X_BT_at(t_s))
        for name, X in zip(FRAMES, (*poses, poses[FLANGE] @ X_FH), strict=True):
            yield _transform(t_s, "base", name, X)
    for t_s in times_s[:1]:
        yield _transform(t_s, "base", "camera_colour", X_BC)
        yield _transform(t_s, "camera_colour", "camera_depth", model.X_CD)


def event(t_s: float, text: str, *, is_warning: bool = False) -> Message:
    """One line of the events, at a time on the arm's clock."""
    t_ns = _ns(t_s)
    return t_ns, EVENTS, cdr.log(t_ns, 30 if is_warning else 20, "adaptsim", text)


def outcome(t_s: float, values: dict[str, object]) -> Message:
    """How a trial ended, as JSON."""
    return _ns(t_s), OUTCOME, cdr.text(json.dumps(values, allow_nan=False))


def derivative(t_s: Array, values: Array, order: int) -> Array:
    """The derivative (N, ...) of values (N, ...) at evenly spaced times; 0 if there are too few values."""
    if len(t_s) < 5:
        return np.zeros_like(values)
    from scipy.signal import savgol_filter  # slow to import, and only a finished motion needs it

    step_s = float(np.median(np.diff(t_s)))
    odd = 2 * (round(SMOOTHED_S / step_s) // 2) + 1
    window = max(5, min(odd, len(t_s) - 1 + len(t_s) % 2))
    return np.asarray(savgol_filter(values, window, 3, deriv=order, delta=step_s, axis=0))


def _info(t_ns: int, frame: str, camera: Intrinsics) -> bytes:
    return cdr.camera_info(t_ns, frame, (camera.width, camera.height), camera.K, camera.distortion)


def _transform(t_s: float, parent: str, child: str, X: Array) -> Message:
    t_ns, xyzw = _ns(t_s), Rotation.from_matrix(X[:3, :3]).as_quat().tolist()
    return t_ns, TRANSFORMS, cdr.transform(t_ns, parent, child, X[:3, 3].tolist(), xyzw)


def _ns(t_s: float) -> int:
    return round(t_s * 1e9)
