"""The trackers of the objects: one function per kind of task, chosen by `Hardware.tracker`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from adaptsim_cli.bench.rig import Detection, Tracker, TrackRequest
from hw.types import Array, CameraModel, Frame
from perception.types import ObjectTrack, Outcome
from sim.errors import UnknownName
from sim.tasks.task import Task

Find = Callable[[Frame, CameraModel, Array], Detection]
"""(frame, model, X_BC) -> detection; see `Tracker.find`."""

SMALLEST_HALF_M, LARGEST_HALF_M = 0.004, 0.025
"""Half widths along X of the pieces that are searched for."""


def tracker_of(task: Task) -> Tracker:
    """The tracker of a task. Raises UnknownName, NoHardware."""
    name = task.require_hardware().tracker
    if name not in TRACKERS:
        raise UnknownName(f"no tracker {name!r} for {task.name}: there are {', '.join(TRACKERS)}")
    tracker = TRACKERS[name](task)
    return replace(tracker, find=_once(tracker.find))


def _once(find: Find) -> Find:
    """`find` that searches a picture once: the object is needed before the motion, and again for its track."""
    last: list[tuple[tuple[bytes, ...], Detection]] = []

    def detect(frame: Frame, model: CameraModel, X_BC: Array) -> Detection:
        lenses = (model.colour.K, model.colour.distortion, model.depth.K, model.depth.distortion, model.X_CD)
        key = (frame.colour.tobytes(), frame.depth_mm.tobytes(), *(part.tobytes() for part in (X_BC, *lenses)))
        if not last or last[0][0] != key:
            last[:] = [(key, find(frame, model, X_BC))]
        return last[0][1]

    return detect


def _piece(task: Task) -> Tracker:
    """The tracker of a piece of food, which uses the blade's kinematic pose; the context is the piece's near side."""
    from perception import piece
    from perception.overlay import overlay_piece
    from sim.tasks.shared.direct import tool_mesh

    mesh = tool_mesh(task)
    x, y = task.context.dimensions[:2]
    area = (x.low, x.high, y.low, y.high)
    centres = (x.low + SMALLEST_HALF_M, x.high + LARGEST_HALF_M, y.low, y.high)

    def track(request: TrackRequest) -> ObjectTrack:
        return piece.track_piece(
            request.frames,
            request.model,
            request.X_BC,
            request.detection,
            mesh,
            request.X_BT_at,
            request.t_start_s,
            request.duration_s,
        )

    return Tracker(
        find=lambda frame, model, X_BC: piece.find_piece(frame, model, X_BC, centres),
        overlay=lambda frame, model, X_BC, detection, drawn: overlay_piece(
            frame, model, X_BC, detection, area, drawn[:2]
        ),
        track=track,
        placement=lambda drawn: drawn,
        context=lambda drawn, detection: detection.near_m,
        outcomes=(Outcome.ON_BLADE, Outcome.ON_TABLE, Outcome.LOST),
        at_home=piece.at_home,
        lies_at_home=piece.lies_at_home,
    )


BOTTLE_AREA = (0.42, 1.22, -0.36, 0.36)
"""The part of the table searched for a bottle, x and y in the base frame in m: everything in the camera's view."""


def _bottle(task: Task) -> Tracker:
    """The tracker of a bottle, from its mark until it rests; the context is a goal."""
    from hw.capsules import segments
    from hw.kinematics import link_poses
    from hw.outline import ARM, FINGERS, HAND
    from perception import bottle
    from perception.arm_mask import ArmShape, Capsules, ToolMask
    from perception.cylinder import Cylinder
    from perception.overlay import overlay_bottle
    from sim.tasks.shared.direct import tool_mesh

    standing, goal_m = task.require_hardware().standing, task.goal_m
    if standing is None or goal_m is None:
        raise ValueError(f"{task.name}: an object that stands on a mark and has a goal needs `standing` and `goal_m`")
    mark_m, body = standing.mark_m, Cylinder(standing.radius_m, standing.height_m)
    tool = ToolMask(*tool_mesh(task))
    outline = (*ARM, *HAND, *FINGERS)
    radii_m = np.array([capsule.radius_m for capsule in outline])

    def track(request: TrackRequest) -> ObjectTrack:
        def arm_at(t_s: float) -> ArmShape:
            ends_m = segments(link_poses(request.q_at(t_s)), outline)
            return ArmShape(Capsules(ends_m, radii_m), tool, request.X_BT_at(t_s))

        return bottle.track_bottle(
            request.frames,
            request.model,
            request.X_BC,
            request.detection,
            arm_at,
            request.t_start_s,
            request.duration_s,
            BOTTLE_AREA,
        )

    return Tracker(
        find=lambda frame, model, X_BC: bottle.find_bottle(frame, model, X_BC, body, BOTTLE_AREA, mark_m),
        overlay=lambda frame, model, X_BC, detection, drawn: overlay_bottle(
            frame, model, X_BC, detection, body, mark_m, goal_m(drawn)
        ),
        track=track,
        placement=lambda drawn: np.array(mark_m),
        context=lambda drawn, detection: np.asarray(drawn),
        outcomes=(Outcome.UPRIGHT, Outcome.TIPPED, Outcome.LOST),
    )


TRACKERS: dict[str, Callable[[Task], Tracker]] = {"piece": _piece, "bottle": _bottle}
"""`Hardware.tracker` -> the function that makes the tracker."""
