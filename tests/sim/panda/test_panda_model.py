import numpy as np
import pytest
from pydrake.multibody.plant import MultibodyPlant

from hw.joint_limits import LIMITS
from hw.kinematics import FLANGE, forward, link_poses
from sim.panda.model import BRANCHES, FLANGE_NAME, JOINT_NAMES, add_panda, inverse, urdf
from sim.panda.shapes import PRIMITIVES, mesh, visuals


@pytest.fixture(scope="module")
def plant() -> MultibodyPlant:
    plant = MultibodyPlant(0.001)
    add_panda(plant)
    plant.Finalize()
    return plant


def test_drakes_kinematics_equal_the_numpy_model(plant: MultibodyPlant) -> None:
    context = plant.CreateDefaultContext()
    limits = LIMITS["panda"]
    rng = np.random.default_rng(3)
    names = [*(f"panda_link{i}" for i in range(8)), FLANGE_NAME]
    for q in rng.uniform(limits.q_min_rad, limits.q_max_rad, (25, 7)):
        plant.SetPositions(context, q)
        poses = [plant.GetBodyByName(n).EvalPoseInWorld(context).GetAsMatrix4() for n in names]
        assert np.abs(np.array(poses) - link_poses(q)).max() < 1e-9
    assert len(names) == FLANGE + 1


@pytest.mark.parametrize("model", ["panda", "fr3", "fr3v2"])
def test_joints_are_in_order_with_actuators_and_the_makers_limits(model: str) -> None:
    plant = MultibodyPlant(0.001)
    instance = add_panda(plant, model)
    plant.Finalize()
    assert plant.num_positions(instance) == 7
    assert [plant.GetJointByName(name).position_start() for name in JOINT_NAMES] == list(range(7))
    assert plant.num_actuators() == 7
    assert np.allclose(plant.GetPositionLowerLimits(), LIMITS[model].q_min_rad)
    assert np.allclose(plant.GetPositionUpperLimits(), LIMITS[model].q_max_rad)


def test_mass_is_that_of_the_description(plant: MultibodyPlant) -> None:
    """Links 0 to 7 together 16.7 kg, and the hand 0.73 kg."""
    context = plant.CreateDefaultContext()
    assert plant.CalcTotalMass(context) == pytest.approx(16.691 + 0.73, abs=0.01)


def test_meshes_are_closed_and_point_outward() -> None:
    """The enclosed volume by the divergence theorem is that of the solid, up to the facets."""
    for primitive in PRIMITIVES:
        vertices, triangles = mesh(primitive)
        a, b, c = (vertices[triangles[:, k]] for k in range(3))
        volume = np.einsum("ij,ij->i", a - vertices.mean(axis=0), np.cross(b - a, c - a)).sum() / 6.0
        if primitive.kind == "box":
            expected = float(np.prod(primitive.size))
        elif primitive.kind == "cylinder":
            expected = np.pi * primitive.size[0] ** 2 * primitive.size[1]
        else:
            expected = 4.0 / 3.0 * np.pi * primitive.size[0] ** 3
        assert volume == pytest.approx(expected, rel=0.08)
        edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
        assert sorted(map(tuple, edges)) == sorted(map(tuple, edges[:, ::-1]))


def test_looks_and_urdf_have_one_source(plant: MultibodyPlant) -> None:
    seen = visuals()
    assert {v.body for v in seen} == {p.link for p in PRIMITIVES}
    for visual in seen:
        assert plant.HasBodyNamed(visual.body)
        assert visual.triangles.max() < len(visual.vertices_m)
    assert urdf().count("<visual>") == len(PRIMITIVES)


def test_the_urdf_draws_cylinders_where_the_meshes_are() -> None:
    """Axis of a URDF cylinder is Z turned by roll, pitch, yaw; ends of the mesh must lie along it."""
    for primitive in PRIMITIVES:
        if primitive.kind == "cylinder":
            vertices, _ = mesh(primitive)
            spread = np.ptp(vertices, axis=0)
            assert spread["xyz".index(primitive.axis)] == pytest.approx(primitive.size[1])


def postures(n: int) -> np.ndarray:
    low, high = LIMITS["panda"].q_min_rad.copy(), LIMITS["panda"].q_max_rad.copy()
    high[3] = -0.5  # the other fold of the elbow begins at -0.47
    return np.random.default_rng(5).uniform(low, high, (n, 7))


def test_every_branch_reaches_the_pose_exactly_and_one_is_the_posture_itself() -> None:
    q = postures(500)
    found = inverse(forward(q), q[:, 6])
    reached = np.isfinite(found).all(axis=-1)
    error = np.abs(forward(np.nan_to_num(found)) - forward(q)[:, None]).max(axis=(-1, -2))
    assert error[reached].max() < 1e-12
    nearest = np.nanmin(np.nanmax(np.abs(found - q[:, None]), axis=-1), axis=-1)
    assert nearest.max() < 1e-6


def test_branches_differ() -> None:
    q = postures(1)[0]
    found = inverse(forward(q), q[6])
    assert found.shape == (BRANCHES, 7)
    gaps = [np.abs(found[i] - found[j]).max() for i in range(BRANCHES) for j in range(i)]
    assert min(gaps) > 1e-3


def test_out_of_reach_is_nan() -> None:
    X_BF = np.eye(4)
    X_BF[:3, 3] = [1.5, 0.0, 0.5]
    assert np.isnan(inverse(X_BF, np.array(0.3))).any(axis=-1).all()


def test_leading_axes_broadcast() -> None:
    X_BF, q7 = forward(postures(6)), np.linspace(-1.0, 1.0, 5)
    grid = inverse(X_BF[:, None], q7)
    assert grid.shape == (6, 5, BRANCHES, 7)
    assert np.array_equal(grid[2, 3], inverse(X_BF[2], q7[3]), equal_nan=True)


def test_a_branch_is_continuous_along_a_path() -> None:
    start, end = np.array([0.1, -0.4, 0.2, -2.3, 0.1, 1.7, 0.6]), np.array([0.3, -0.1, 0.0, -2.0, 0.3, 1.9, 0.4])
    q = start + np.linspace(0.0, 1.0, 200)[:, None] * (end - start)
    found = inverse(forward(q), q[:, 6])
    branch = int(np.abs(found[0] - q[0]).max(axis=-1).argmin())
    assert np.abs(found[:, branch] - q).max() < 1e-9
