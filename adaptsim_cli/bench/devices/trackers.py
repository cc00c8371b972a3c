"""The trackers of the objects: one function per kind of task, chosen by `Hardware.tracker`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from adaptsim_cli.bench.rig import Recording, Tracker, TrackRequest
from perception.types import ObjectTrack, Outcome
from sim.errors import UnknownName
from sim.tasks.task import Task

SMALLEST_HALF_M, LARGEST_HALF_M = 0.004, 0.025
"""Half widths along X of the pieces that are searched for."""


def tracker_of(task: Task) -> Tracker:
    """The tracker of a task. Raises UnknownName, NoHardware."""
    name = task.require_hardware().tracker
    if name not in TRACKERS:
        raise UnknownName(f"no tracker {name!r} for {task.name}: there are {', '.join(TRACKERS)}")
    return TRACKERS[name](task)


def _piece(task: Task) -> Tracker:
    """The tracker of a piece of food, which uses the blade's kinematic pose; the context is the piece's near side."""
    from perception import piece
    from perception.knock import with_knock
    from perception.overlay import overlay_piece
    from perception.piece.alone import find_alone
    from sim.tasks.shared.tool_mesh import tool_mesh

    mesh = tool_mesh(task)
    x, y = task.context.dimensions[:2]
    area = (x.low, x.high, y.low, y.high)
    centres = (x.low + SMALLEST_HALF_M, x.high + LARGEST_HALF_M, y.low, y.high)

    def track(request: TrackRequest) -> ObjectTrack:
        film = request.recording
        followed = piece.track_piece(
            frames=film.frames,
            model=film.model,
            X_BC=film.X_BC,
            detection=request.detection,
            tool_mesh=mesh,
            X_BT_at=request.X_BT_at,
            t_start_s=film.execution.t_start_s,
            duration_s=request.duration_s,
        )
        return with_knock(followed, film.frames, film.execution.t_start_s)

    def at_home(track: ObjectTrack, detection: Any, film: Recording) -> ObjectTrack:
        if film.after is None:
            return track
        return piece.at_home(track, detection, film.before, film.after, film.model, film.X_BC)

    def lies_at_home(track: ObjectTrack, detection: Any, film: Recording) -> ObjectTrack | None:
        if film.after is None:
            return None
        return piece.lies_at_home(track, detection, film.before, film.after, film.model, film.X_BC)

    return Tracker(
        find=lambda frame, model, X_BC: find_alone(frame, model, X_BC, centres),
        overlay=lambda frame, model, X_BC, detection, drawn: overlay_piece(
            frame, model, X_BC, detection, area, drawn[:2]
        ),
        track=track,
        placement=lambda drawn: drawn,
        context=lambda drawn, detection: detection.near_m,
        outcomes=(Outcome.ON_BLADE, Outcome.ON_TABLE, Outcome.LOST),
        at_home=at_home,
        lies_at_home=lies_at_home,
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
    from perception.knock import with_knock
    from perception.overlay import overlay_bottle
    from sim.tasks.shared.tool_mesh import tool_mesh

    standing, goal_m = task.require_hardware().standing, task.goal_m
    if standing is None or goal_m is None:
        raise ValueError(f"{task.name}: an object that stands on a mark and has a goal needs `standing` and `goal_m`")
    mark_m, body = standing.mark_m, Cylinder(standing.radius_m, standing.height_m)
    tool = ToolMask(*tool_mesh(task))
    outline = (*ARM, *HAND, *FINGERS)
    radii_m = np.array([capsule.radius_m for capsule in outline])

    def track(request: TrackRequest) -> ObjectTrack:
        film = request.recording

        def arm_at(t_s: float) -> ArmShape:
            ends_m = segments(link_poses(film.execution.q_at(t_s)), outline)
            return ArmShape(Capsules(ends_m, radii_m), tool, request.X_BT_at(t_s))

        followed = bottle.track_bottle(
            frames=film.frames,
            model=film.model,
            X_BC=film.X_BC,
            detection=request.detection,
            arm_at=arm_at,
            t_start_s=film.execution.t_start_s,
            duration_s=request.duration_s,
            area=BOTTLE_AREA,
        )
        return with_knock(followed, film.frames, film.execution.t_start_s)

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
