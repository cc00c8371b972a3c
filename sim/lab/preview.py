"""A planned motion in the browser: arm, tool, table and object with the lab's looks. Nothing is simulated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import Box, Meshcat, MeshcatAnimation, MeshcatParams, Rgba
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.multibody.tree import RigidBody
from pydrake.systems.framework import DiagramBuilder

from hw.collision import KeepOut, Table
from hw.types import Array, JointPath
from sim.lab.kinect import kinect_model, looking
from sim.panda.model import FLANGE_NAME, JOINT_NAMES, add_panda
from sim.panda.shapes import visuals
from sim.render.renderer import WORLD, Renderer
from sim.tasks.shared.contact import silence, vector
from sim.tasks.task import Task
from sim.types import Visual

FRAMES_PER_S = 30.0
SEEN_M = 1.5
"""The surroundings of an arm are drawn up to this distance from its base, along each axis."""
_MESHCAT_TITLE = "<title>Drake MeshCat</title>"
_LIFT_M = 0.002  # of the work area, so that it lies above the table top
_AREA, _BOX = Rgba(0.2, 0.6, 0.3, 0.4), Rgba(0.8, 0.2, 0.1, 0.25)


class PathPreview:
    """A page, only on this machine (127.0.0.1), that plays a trial's paths in a loop."""

    def __init__(self, task: Task, context: Array, paths: Sequence[JointPath]) -> None:
        """The object lies at `context` (c,), with all parameters in the middle of their ranges. Raises NoHardware."""
        hardware = task.require_hardware()
        plant, _ = AddMultibodyPlantSceneGraph(DiagramBuilder(), hardware.time_step_s(None))
        add_panda(plant)
        parameters, nuisance = (s.middle for s in (task.parameters, task.nuisance))
        bodies = hardware.build_scene(
            plant, plant.GetFrameByName(FLANGE_NAME), hardware.X_FT, parameters, nuisance, None
        )
        plant.Finalize()
        silence()  # it would announce its own address
        self._meshcat: Any = Meshcat(MeshcatParams(host="127.0.0.1", show_stats_plot=False))
        shown = (*visuals(), *bodies.visuals)
        for i, visual in enumerate(shown):
            self._add(i, visual)
        state = plant.CreateDefaultContext()
        X_BO = RigidTransform(hardware.rest_pose(context, parameters, nuisance, None))
        plant.SetFreeBodyPose(state, plant.GetBodyByName(bodies.object), X_BO)
        joints = [plant.GetJointByName(name) for name in JOINT_NAMES]
        names = sorted({v.body for v in shown} - {"world"})
        moving: dict[str, RigidBody] = {name: plant.GetBodyByName(name) for name in names}
        animation = MeshcatAnimation(FRAMES_PER_S)
        for frame, q_rad in enumerate(_frames(paths)):
            for joint, q in zip(joints, q_rad, strict=True):
                joint.set_angle(state, q)
            for name, body in moving.items():
                X_BL = body.EvalPoseInWorld(state)
                animation.SetTransform(frame, f"/scene/{name}", X_BL)
                if frame == 0:
                    self._meshcat.SetTransform(f"/scene/{name}", X_BL)
        self._meshcat.SetAnimation(animation)
        for clutter in ("/Grid", "/Axes"):
            self._meshcat.SetProperty(clutter, "visible", False)
        self._meshcat.SetCameraPose(vector(1.25, -0.95, 0.75), vector(0.45, 0.0, 0.2))

    def surround(
        self, table: Table, x_m: tuple[float, float], y_m: tuple[float, float], boxes: Sequence[KeepOut]
    ) -> None:
        """Draw a rig around it, as far as `SEEN_M`: the work area `x_m` by `y_m` on its table, and keep-out boxes."""
        self._meshcat.Delete("/rig")
        corners = [(x, y) for x in np.clip(x_m, -SEEN_M, SEEN_M) for y in np.clip(y_m, -SEEN_M, SEEN_M)]
        at = np.array([[x, y, _LIFT_M + table.height_m + table.slope_x * x + table.slope_y * y] for x, y in corners])
        self._meshcat.SetTriangleMesh("/rig/area", at.T, np.array([[0, 2, 1], [1, 2, 3]], np.int32).T, _AREA)
        for number, box in enumerate(boxes):
            low_m, high_m = np.maximum(box.low_m, -SEEN_M), np.minimum(box.high_m, SEEN_M)
            if (low_m < high_m).all():
                self._meshcat.SetObject(f"/rig/box-{number}", Box(*(high_m - low_m).tolist()), _BOX)
                self._meshcat.SetTransform(f"/rig/box-{number}", RigidTransform(vector(*(low_m + high_m) / 2.0)))

    @property
    def url(self) -> str:
        """The address for a browser on this machine."""
        return str(self._meshcat.web_url())

    def html(self, title: str, panel: str) -> str:
        """The same as one page without a server, with the HTML `panel` over it."""
        page = str(self._meshcat.StaticHtml())
        return page.replace(_MESHCAT_TITLE, f"<title>{escape(title)}</title>", 1).replace("<body>", f"<body>{panel}", 1)

    def _add(self, index: int, visual: Visual) -> None:
        red, green, blue = (_display(value) for value in visual.rgb)
        path = f"/scene/{visual.body}/{index}"
        self._meshcat.SetTriangleMesh(
            path, visual.vertices_m.T, visual.triangles.T.astype(np.int32), Rgba(red, green, blue)
        )


def _frames(paths: Sequence[JointPath]) -> Array:
    """(N, 7) joints of all paths in a row, at the rate of the animation."""
    q_rad = np.concatenate([path.q_rad for path in paths])
    t_s = np.arange(len(q_rad)) / 1000.0
    wanted_s = np.arange(0.0, t_s[-1], 1.0 / FRAMES_PER_S)
    return np.stack([np.interp(wanted_s, t_s, joint) for joint in q_rad.T], axis=-1)


def _display(linear: float) -> float:
    """Linear albedo -> sRGB (IEC 61966-2-1)."""
    return float(12.92 * linear if linear <= 0.0031308 else 1.055 * linear ** (1.0 / 2.4) - 0.055)


FROM_M = np.array([0.22, -0.30, 0.26])
"""The direction of the camera from the object: ahead, to the right, above."""

PANEL_PX = 360
"""Width and height of the picture of one object."""

FILLED = 0.55
"""Share of that picture which the largest object fills."""


@dataclass(frozen=True, eq=False)
class ObjectPicture:
    """An object at its place, seen from near."""

    rgb: NDArray[np.uint8]  # (PANEL_PX, PANEL_PX, 3)
    px_per_m: float  # at the object's distance


def low_middle_high(task: Task) -> tuple[ObjectPicture, ...]:
    """The object with all parameters and sizes at the lower end, in the middle and at the upper end of their ranges,
    on one scale. Raises NoHardware.
    """
    spaces = task.parameters, task.nuisance
    points = [[space.low for space in spaces], [space.middle for space in spaces], [space.high for space in spaces]]
    scenes = [_object_scene(task, *point) for point in points]
    extent_m = max(extent for *_, extent in scenes)
    away_m = extent_m * kinect_model().colour.K[0, 0] / (FILLED * PANEL_PX)
    return tuple(_object_picture(poses, shown, X_BO, away_m) for poses, shown, X_BO, _ in scenes)


def _object_scene(
    task: Task, parameters: Array, nuisance: Array
) -> tuple[dict[str, Array], Sequence[Visual], Array, float]:
    """Poses of all bodies, their looks, the object's pose, and its largest extent in m."""
    hardware = task.require_hardware()
    start = hardware.plan(task.reference_context, task.action.middle).X_BT[0]
    plant, _ = AddMultibodyPlantSceneGraph(DiagramBuilder(), hardware.time_step_s(None))
    bodies = hardware.build_scene(plant, plant.world_frame(), start, parameters, nuisance, None)
    plant.Finalize()
    state = plant.CreateDefaultContext()
    X_BO = hardware.rest_pose(task.reference_context, parameters, nuisance, None)
    plant.SetFreeBodyPose(state, plant.GetBodyByName(bodies.object), RigidTransform(X_BO))
    names = {visual.body for visual in bodies.visuals} - {WORLD}
    poses = {name: plant.GetBodyByName(name).EvalPoseInWorld(state).GetAsMatrix4()[None] for name in names}
    own = np.concatenate([visual.vertices_m for visual in bodies.visuals if visual.body == bodies.object])
    return poses, bodies.visuals, X_BO, float(np.ptp(own, axis=0).max())


def _object_picture(poses: dict[str, Array], shown: Sequence[Visual], X_BO: Array, away_m: float) -> ObjectPicture:
    model, eye_m = kinect_model(), away_m * FROM_M / np.linalg.norm(FROM_M)
    whole = Renderer(model, looking(X_BO[:3, 3] + eye_m, -eye_m), shown).render(poses, None, np.random.default_rng(0))
    top, left = (size // 2 - PANEL_PX // 2 for size in whole[0].shape[:2])
    return ObjectPicture(whole[0][top : top + PANEL_PX, left : left + PANEL_PX], float(model.colour.K[0, 0]) / away_m)
