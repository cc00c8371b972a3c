import numpy as np

from hw.joint_limits import LIMITS
from hw.kinematics import forward
from sim.panda.model import BRANCHES, inverse


def postures(n: int) -> np.ndarray:
    low, high = LIMITS["panda"].q_min_rad.copy(), LIMITS["panda"].q_max_rad.copy()
    high[3] = -0.5  # the other fold of the elbow begins at -0.47
    return np.random.default_rng(5).uniform(low, high, (n, 7))


def test_every_branch_reaches_the_pose_exactly() -> None:
    q = postures(500)
    found = inverse(forward(q), q[:, 6])
    reached = np.isfinite(found).all(axis=-1)
    error = np.abs(forward(np.nan_to_num(found)) - forward(q)[:, None]).max(axis=(-1, -2))
    assert error[reached].max() < 1e-12


def test_one_branch_is_the_posture_itself() -> None:
    q = postures(500)
    found = inverse(forward(q), q[:, 6])
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
