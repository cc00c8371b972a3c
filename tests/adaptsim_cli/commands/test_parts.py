"""The parts to print: closed solids with the scene's mass, that the hand can hold."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from adaptsim_cli.bench import printed_parts as sheet
from adaptsim_cli.commands.setup import all_parts
from hw.types import Array
from perception.raycasting import load_open3d
from sim.tasks.pushing import TASK as PUSHING
from sim.tasks.pushing.mount import GRIP_M, PLATE_HEIGHT_M, PLATE_WIDTH_M
from sim.tasks.scooping import TASK as SCOOPING
from sim.tasks.shared.tool_mesh import tool_mesh
from sim.types import Part


def outside_m(part: Part, points: Array) -> Array:
    """Distance of points (n, 3) from the surface, negative inside."""
    open3d = load_open3d()
    tensor: Any = open3d.core.Tensor
    scene: Any = open3d.t.geometry.RaycastingScene()
    scene.add_triangles(tensor(part.solid.vertices.astype(np.float32)), tensor(part.solid.faces.astype(np.uint32)))
    return np.asarray(scene.compute_signed_distance(tensor(points.astype(np.float32))).numpy())


@pytest.fixture(scope="module")
def parts() -> dict[str, Part]:
    return {part.name: part for part in all_parts()}


def test_every_part_is_closed_and_fits_between_the_fingers(parts, printed):
    assert set(parts) == {"pusher", "patch", "adapter", "board-holder"}
    for part in parts.values():
        assert part.solid.is_watertight
        assert part.solid.body_count == 1
        assert part.flat or 0.0 < (part.held_m or 0.0) < sheet.OPENING_M
        assert sheet.printed(part).bounds[0, 2] == pytest.approx(0.0, abs=1e-6)


def test_the_pusher_has_the_mass_and_the_surface_of_the_scene(parts, printed):
    pusher = parts["pusher"]
    share = sheet.infill(pusher)
    assert share is not None
    assert 0.3 < share < 1.0, "a print can have this mass"
    assert np.abs(pusher.solid.center_mass - pusher.mass.com_m).max() < 0.003
    vertices, _ = tool_mesh(PUSHING)
    behind = vertices[vertices[:, 0] < 1e-6]
    assert outside_m(pusher, behind).max() < 1e-4, "the mask of the tool covers the same body"
    assert pusher.solid.bounds[1, 0] == pytest.approx(0.0, abs=1e-6), "nothing stands out of the plate's face"
    size = np.sort(sheet.printed(pusher).extents)
    assert size[-1] >= 1e3 * PLATE_WIDTH_M
    assert (outside_m(pusher, np.array([GRIP_M, [-0.002, 0.0, PLATE_HEIGHT_M / 2]])) < 0.0).all()


def test_a_handle_fits_into_the_adapter(parts):
    half = parts["adapter"]
    assert half.solid.bounds[1, 2] < 0.0, "the halves do not touch: screws clamp the handle"
    assert (outside_m(half, np.array([[0.0, 0.0115, -0.0088], [0.0, -0.0115, -0.0088]])) > 0.0).all()
    assert (outside_m(half, np.array([[0.0, 0.018, -0.005], [0.0, 0.0, -0.013]])) < 0.0).all()


def test_the_command_writes_solids_and_a_sheet(tmp_path, refused, printed):
    out = tmp_path / "parts"
    told = printed("parts", "--out", str(out), "--json")
    assert [Path(part["file"]).name for part in told["parts"]] == ["pusher.stl", "adapter.stl", "board-holder.stl"]
    assert (out / "parts.pdf").read_bytes().startswith(b"%PDF")
    assert all(len((out / f"{name}.stl").read_bytes()) > 84 for name in ("pusher", "adapter", "board-holder"))
    assert "another folder" in refused(2, "parts", "--out", str(out))


def test_each_solid_as_written_is_watertight_for_another_reader(tmp_path, printed):
    open3d = load_open3d()
    out = tmp_path / "parts"
    printed("parts", "--out", str(out), "--json")
    for name in ("pusher", "adapter", "board-holder"):
        mesh: Any = open3d.io.read_triangle_mesh(str(out / f"{name}.stl"))
        mesh.remove_duplicated_vertices()
        assert mesh.is_watertight(), name
        assert mesh.is_orientable(), name


def test_touch_off_expects_the_adapter_that_is_printed(parts):
    touchable = SCOOPING.require_hardware().touchable
    assert touchable is not None
    assert parts["adapter"].held_m == touchable.held_m
