"""The same scene by ray casting and by Drake's VTK engine: two renderers, one geometry."""

from __future__ import annotations

import numpy as np
from pydrake.geometry import (
    Box,
    ClippingRange,
    ColorRenderCamera,
    Cylinder,
    DepthRange,
    DepthRenderCamera,
    GeometryInstance,
    IllustrationProperties,
    MakeRenderEngineVtk,
    PerceptionProperties,
    RenderCameraCore,
    RenderEngineVtkParams,
    RenderLabel,
    Rgba,
    SceneGraph,
)
from pydrake.math import RigidTransform
from pydrake.systems.sensors import CameraInfo
from table_scenes import at

from hw.types import Array, CameraModel, Intrinsics
from sim.lab.kinect import default_X_BC
from sim.render.renderer import Renderer
from sim.tasks.shared.shapes import box, turned_body
from sim.types import Visual

WIDTH, HEIGHT = 320, 240
FOCAL = 600.0
SEGMENTS = 96
R_M, H_M = 0.03, 0.05
BLADE_M = (0.10, 0.08, 0.004)


def camera() -> Intrinsics:
    return Intrinsics(WIDTH, HEIGHT, np.array([[FOCAL, 0, 159.5], [0, FOCAL, 119.5], [0, 0, 1.0]]))


POSES = {"table": at(0.75, 0, -0.02), "piece": at(0.75, 0.05, H_M / 2), "blade": at(0.72, -0.04, 0.04, 0.2)}
SHAPES = {"table": Box(1.0, 1.2, 0.04), "piece": Cylinder(R_M, H_M), "blade": Box(*BLADE_M)}


def by_vtk() -> tuple[Array, Array]:
    """Depth in metres and label images."""
    scene = SceneGraph()
    scene.AddRenderer("vtk", MakeRenderEngineVtk(RenderEngineVtkParams(backend="EGL")))
    source = scene.RegisterSource("scene")
    for label, (name, shape) in enumerate(SHAPES.items(), start=1):
        instance = GeometryInstance(RigidTransform(POSES[name]), shape, name)
        instance.set_illustration_properties(IllustrationProperties())
        properties = PerceptionProperties()
        properties.AddProperty("label", "id", RenderLabel(label))
        properties.AddProperty("phong", "diffuse", Rgba(0.5, 0.5, 0.5))
        instance.set_perception_properties(properties)
        scene.RegisterAnchoredGeometry(source, instance)
    query = scene.get_query_output_port().Eval(scene.CreateDefaultContext())
    info = CameraInfo(WIDTH, HEIGHT, FOCAL, FOCAL, 160.0, 120.0)  # Drake's pixel centres lie at halves
    core = RenderCameraCore("vtk", info, ClippingRange(0.05, 5.0), RigidTransform())
    X_BC = RigidTransform(default_X_BC())
    parent = scene.world_frame_id()
    depth = query.RenderDepthImage(DepthRenderCamera(core, DepthRange(0.1, 4.0)), parent, X_BC)
    label = query.RenderLabelImage(ColorRenderCamera(core, False), parent, X_BC)
    return depth.data[..., 0].astype(np.float64), label.data[..., 0].astype(np.int64)


def by_ray_casting() -> tuple[Array, Array]:
    """Depth in metres and the colour image; depth and colour camera are one here."""
    table = box(np.array([1.0, 1.2, 0.04]), POSES["table"][:3, 3])
    piece = turned_body(np.array([[R_M, -H_M / 2], [R_M, H_M / 2]]), SEGMENTS)
    visuals = [
        Visual("world", *table, (0.5, 0.5, 0.5)),
        Visual("piece", *piece, (0.7, 0.02, 0.02)),
        Visual("blade", *box(np.array(BLADE_M), np.zeros(3)), (0.02, 0.02, 0.7)),
    ]
    model = CameraModel("pinhole", camera(), camera(), np.eye(4))
    poses = {name: POSES[name][None] for name in ("piece", "blade")}
    colour, depth_mm = Renderer(model, default_X_BC(), visuals).render(poses, None, np.random.default_rng(0))
    return depth_mm / 1000.0, colour.astype(np.int64)


def test_depth_and_silhouettes_agree() -> None:
    depth_vtk, label = by_vtk()
    depth, colour = by_ray_casting()
    seen = (label >= 1) & (label <= 3)
    off = np.abs(depth - depth_vtk)[seen]
    assert seen.mean() > 0.9
    assert (off < 0.0012).mean() > 0.985  # the rest are pixels on edges
    assert np.median(off) < 0.0005
    red, green, blue = (colour[..., i] for i in range(3))
    for number, mask in ((2, red - blue > 40), (3, blue - red > 40)):
        theirs = label == number
        assert theirs.sum() > 1000
        assert (mask & theirs).sum() / (mask | theirs).sum() > 0.96
    assert (np.abs(red - green)[label == 1] < 8).mean() > 0.98
