"""A planned trial of a rig to look at: the camera's picture with the path of the tool, and the arm along its paths."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adaptsim_cli.bench.rig import Detection, Paths, Planner, Rig, Tracker
from adaptsim_cli.session.live_trial import MotionPreview, PlacedTrial
from hw.kinematics import FLANGE, link_poses
from hw.poses import inverse
from hw.types import Array, Frame
from perception.geometry import project
from sim.tasks.task import Task


@dataclass(frozen=True, eq=False)
class FoundObject(PlacedTrial):
    """A placed trial whose object the camera has found."""

    overlay: bytes  # JPEG of the detection
    frame: Frame  # the object was found in it
    detection: Detection  # of the rig's tracker


def preview_of(
    task: Task, rig: Rig, tracker: Tracker, planner: Planner, placed: FoundObject, paths: Paths
) -> MotionPreview:
    """The picture with the path of the tool, and the arm along all three paths."""
    model, context = rig.camera.model(), task.context
    X_CB = inverse(rig.hand_eye.X_BC)
    begun_s = paths[0].duration_s
    motion_s = (begun_s, begun_s + paths[1].duration_s)
    t_s, q_rad = _decimated(paths)
    X_BF = np.array([planner.flange(q) for q in q_rad])
    tool_m = (X_BF @ task.require_hardware().X_FT)[:, :3, 3]
    joints_m = link_poses(q_rad)[:, :FLANGE, :3, 3]
    path_m = tool_m[(t_s >= motion_s[0]) & (t_s <= motion_s[1])]
    corners = np.array([tracker.placement(corner) for corner in (context.low, context.high)])[:, :2]
    low, high = corners.min(axis=0), corners.max(axis=0)
    return MotionPreview(
        picture=placed.overlay,
        size_px=(model.colour.width, model.colour.height),
        path_px=project(model.colour, X_CB, path_m),
        path_m=path_m,
        t_s=t_s,
        arm_m=np.concatenate([joints_m, X_BF[:, None, :3, 3], tool_m[:, None]], axis=1),
        motion_s=motion_s,
        spot_m=np.asarray(placed.detection.xy_m),
        area_m=np.array([low[0], high[0], low[1], high[1]]),
        goal_m=None if task.goal_m is None else np.asarray(task.goal_m(placed.context)),
    )


_SHOWN = 120
"""Postures of the arm that a page draws, over all three paths."""


def _decimated(paths: Paths) -> tuple[Array, Array]:
    """Times (K,) from the start of the first path, and joints (K, 7), of at most `_SHOWN` postures."""
    starts_s = np.cumsum([0.0, *(path.duration_s for path in paths)])
    t_s = np.concatenate([start + path.t_s for start, path in zip(starts_s, paths, strict=False)])
    q_rad = np.concatenate([path.q_rad for path in paths])
    indices = np.unique(np.linspace(0, len(t_s) - 1, min(_SHOWN, len(t_s))).round().astype(int))
    return t_s[indices], q_rad[indices]
