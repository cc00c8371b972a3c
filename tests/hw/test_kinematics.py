import numpy as np
import pytest

from hw.kinematics import FLANGE, forward, jacobian, link_poses

RNG_SEED = 11


def random_q(*shape: int) -> np.ndarray:
    return np.random.default_rng(RNG_SEED).uniform(-2.5, 2.5, (*shape, 7))


def test_zero_posture_follows_the_makers_lengths() -> None:
    X_BF = forward(np.zeros(7))
    assert np.allclose(X_BF[:3, 3], [0.088, 0.0, 0.333 + 0.316 + 0.384 - 0.107])
    assert np.allclose(X_BF[:3, :3], np.diag([1.0, -1.0, -1.0]))


def test_ready_posture() -> None:
    """The maker's ready pose reaches 0.307 m forward and 0.590 m up with the flange pointing down."""
    X_BF = forward([0.0, -np.pi / 4, 0.0, -3 * np.pi / 4, 0.0, np.pi / 2, np.pi / 4])
    assert np.allclose(X_BF[:3, 3], [0.3069, 0.0, 0.5903], atol=1e-4)
    assert np.allclose(X_BF[:3, 2], [0.0, 0.0, -1.0])


def test_poses_are_rigid_and_the_flange_is_link_7_moved_along_z() -> None:
    poses = link_poses(random_q(20))
    R = poses[..., :3, :3]
    assert np.allclose(R @ np.swapaxes(R, -1, -2), np.eye(3))
    assert np.allclose(np.linalg.det(R), 1.0)
    assert np.allclose(poses[:, FLANGE, :3, 3], poses[:, 7, :3, 3] + 0.107 * poses[:, 7, :3, 2])


def test_leading_axes_are_free() -> None:
    q = random_q(4, 3)
    assert link_poses(q).shape == (4, 3, 9, 4, 4)
    assert jacobian(q).shape == (4, 3, 6, 7)
    assert np.array_equal(forward(q)[2, 1], forward(q[2, 1]))


@pytest.mark.parametrize("p_FT_m", [(0.0, 0.0, 0.0), (0.1, -0.2, 0.3)])
def test_jacobian_is_the_derivative_of_forward(p_FT_m: tuple[float, float, float]) -> None:
    q, step = random_q(), 1e-6
    J = jacobian(q, p_FT_m)
    R = forward(q)[:3, :3]
    point = np.array([*p_FT_m, 1.0])
    for i, nudge in enumerate(step * np.eye(7)):
        change = (forward(q + nudge) - forward(q - nudge)) / (2 * step)
        assert np.allclose(J[:3, i], (change @ point)[:3], atol=1e-8)
        spin = change[:3, :3] @ R.T
        assert np.allclose(J[3:, i], [spin[2, 1], spin[0, 2], spin[1, 0]], atol=1e-8)


def test_wrong_shape_is_refused() -> None:
    with pytest.raises(ValueError, match=r"\(6,\)"):
        forward(np.zeros(6))
