"""The piece: a closed convex body whose mass follows from its shape, resting where the scene puts it."""

import numpy as np
import pytest

from hw.dynamics import GRAVITY_M_S2
from sim.errors import OutOfRange
from sim.tasks.scooping.params import BEVEL_M, EDGE_M, LIP_M, PIECE_DENSITY_KG_M3, SQUARE_LIP_M
from sim.tasks.scooping.piece import blade, make_piece, sink_m
from sim.tasks.shared.shapes import obj_text

HALF = (0.012, 0.012)
EXACT = {0: (np.pi / 6 * 0.024**2 * 0.02, 0.10), 1: (np.pi * 0.012**2 * 0.02, 0.05), 2: (0.024**2 * 0.02, 1e-9)}


@pytest.mark.parametrize("g", [0, 1, 2])
def test_volume_is_that_of_the_shape_but_for_the_facets(g):
    volume_m3, tolerance = EXACT[g]
    assert make_piece(g, 0.02, HALF).volume_m3 == pytest.approx(volume_m3, rel=tolerance)


@pytest.mark.parametrize("g", [0, 1, 2])
def test_is_closed_convex_and_as_high_as_asked(g):
    piece = make_piece(g, 0.02, (0.015, 0.009))
    corners = piece.vertices_m[piece.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    np.testing.assert_allclose(normals.sum(axis=0), 0.0, atol=1e-12)
    height = np.einsum("fvi,fi->fv", piece.vertices_m[None] - corners[:, :1], normals)
    assert (height <= 1e-12).all()
    np.testing.assert_allclose([piece.vertices_m[:, 2].min(), piece.vertices_m[:, 2].max()], [-0.01, 0.01])


def test_inertia_of_a_box_is_the_textbook_one():
    box = make_piece(2, 0.02, (0.01, 0.015))
    expected = [(0.03**2 + 0.02**2) / 12, (0.02**2 + 0.02**2) / 12, (0.02**2 + 0.03**2) / 12]
    np.testing.assert_allclose(box.unit_inertia_m2, np.diag(expected), atol=1e-12)


def test_another_shape_is_refused():
    with pytest.raises(OutOfRange, match="g = 3"):
        make_piece(3, 0.02, HALF)


def test_a_soft_box_sinks_in_until_pressure_carries_it():
    box = make_piece(2, 0.02, HALF)
    mass_kg = PIECE_DENSITY_KG_M3 * box.volume_m3
    depth_m = sink_m(box, mass_kg, 1e4)
    gauge = 1.0 - depth_m / 0.01  # on the slice, as far as no side face is nearer
    side_m = 0.012 * gauge
    flat_N = 1e4 * (1.0 - gauge) * (2.0 * side_m) ** 2
    assert 0.8 * mass_kg * GRAVITY_M_S2 < flat_N < mass_kg * GRAVITY_M_S2
    assert sink_m(box, mass_kg, 1e5) < depth_m / 5


def test_the_blade_is_flat_on_top_and_thin_at_its_edge():
    solid = blade()
    np.testing.assert_allclose(solid.vertices_m[:, 2].max(), 0.0)
    assert solid.vertices_m[:, 2].min() > -EDGE_M
    assert solid.vertices_m[solid.vertices_m[:, 0] == 0.0, 2].max() < -EDGE_M / 2


@pytest.mark.parametrize("lip_m", [0.0001, LIP_M, 0.0008])
def test_a_blunter_edge_has_a_shorter_bevel_of_the_same_slope(lip_m):
    top_m = blade(lip_m).vertices_m
    bevel_m = -top_m[(top_m[:, 2] == 0.0) & (top_m[:, 0] > -0.05), 0].max()
    assert (SQUARE_LIP_M - lip_m) / bevel_m == pytest.approx((SQUARE_LIP_M - LIP_M) / BEVEL_M)


def test_a_square_edge_is_as_high_as_the_blade():
    solid = blade(SQUARE_LIP_M)
    assert len(solid.vertices_m) == 8
    assert np.ptp(solid.vertices_m[solid.vertices_m[:, 0] == 0.0, 2]) == pytest.approx(SQUARE_LIP_M)


def test_obj_lists_every_vertex_and_face():
    piece = make_piece(1, 0.02, HALF)
    lines = obj_text(piece.vertices_m, piece.triangles).splitlines()
    assert sum(line.startswith("v ") for line in lines) == len(piece.vertices_m)
    assert sum(line.startswith("f ") for line in lines) == len(piece.triangles)
