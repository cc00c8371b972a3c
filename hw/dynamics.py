"""The load of a motion on the arm: joint torques, and velocity and acceleration of the flange.

Recursive Newton-Euler, all samples at once, in the axes of the base (Featherstone, "Rigid Body Dynamics Algorithms",
2008, chapter 5). Links are rigid, and there is no friction. The torque is that at the output of the gears, which the
arm's sensors measure and to which its limits refer. The base stands level.

The Panda's masses, centres of mass and inertia are those of the maker's robot description, which cites Gaz et al.,
"Dynamic identification of the Franka Emika Panda robot with retrieval of feasible parameters" (2019). The FR3's are
those that the maker publishes since December 2023 (`franka_description`, robots/fr3/inertials.yaml), the FR3 v2's those
of robots/fr3v2/inertials.yaml.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from hw.kinematics import FLANGE, FLANGE_M, JOINTS, link_poses
from hw.mass import Mass
from hw.types import Array

GRAVITY_M_S2 = 9.81


def _mass(kg: float, com_m: tuple[float, ...], inertia: tuple[float, ...]) -> Mass:
    """`inertia`: xx yy zz xy xz yz in kg m², about the centre of mass."""
    xx, yy, zz, xy, xz, yz = inertia
    return Mass(kg, np.array(com_m), np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))


LINKS: dict[str, tuple[Mass, ...]] = {
    "panda": (
        _mass(0.629769, (-0.041018, -0.00014, 0.049974), (0.00315, 0.00388, 0.004285, 8.2904e-7, 0.00015, 8.2299e-6)),
        _mass(4.970684, (0.003875, 0.002081, -0.04762), (0.70337, 0.70661, 0.009117, -0.000139, 0.006772, 0.019169)),
        _mass(0.646926, (-0.003141, -0.02872, 0.003495), (0.007962, 0.02811, 0.025995, -0.003925, 0.010254, 0.000704)),
        _mass(
            3.228604, (0.027518, 0.039252, -0.066502), (0.037242, 0.036155, 0.01083, -0.004761, -0.011396, -0.012805)
        ),
        _mass(3.587895, (-0.05317, 0.104419, 0.027454), (0.025853, 0.019552, 0.028323, 0.007796, -0.001332, 0.008641)),
        _mass(
            1.225946, (-0.011953, 0.041065, -0.038437), (0.035549, 0.029474, 0.008627, -0.002117, -0.004037, 0.000229)
        ),
        _mass(
            1.666555, (0.060149, -0.014117, -0.010517), (0.001964, 0.004354, 0.005433, 0.000109, -0.001158, 0.000341)
        ),
        _mass(
            0.735522, (0.010517, -0.004252, 0.061597), (0.012516, 0.010027, 0.004815, -0.000428, -0.001196, -0.000741)
        ),
    ),
    "fr3": (
        _mass(2.3966, (-0.0172, 0.0004, 0.0745), (0.009, 0.0115, 0.0085, 0.0, 0.002, 0.0)),
        _mass(
            2.9274653454,
            (4.128e-07, -0.01812513, -0.0386036),
            (0.02392732, 0.02248216, 0.006350098, 1.33179e-05, -0.0001140477, -0.001995032),
        ),
        _mass(
            2.9355370338,
            (0.003182886, -0.07432216, 0.008814608),
            (0.04193895, 0.02514515, 0.06170214, 0.0002025733, 0.004077784, -0.004225216),
        ),
        _mass(
            2.2449013699,
            (0.04070157, -0.004820057, -0.02897308),
            (0.02410143, 0.01974053, 0.01904449, 0.002404695, -0.002856269, -0.002104213),
        ),
        _mass(
            2.6155955791,
            (-0.0459101, 0.0630493, -0.008518787),
            (0.03452998, 0.02888162, 0.04125471, 0.01322552, 0.01015143, -0.0009762834),
        ),
        _mass(
            2.3271207594,
            (-0.00160396, 0.02925363, -0.0972966),
            (0.05161028, 0.0478773, 0.01642363, -0.005715173, -0.003567317, 0.01067399),
        ),
        _mass(
            1.8170376524,
            (0.05971312, -0.04102947, -0.01016927),
            (0.005412334, 0.01405833, 0.01608082, 0.006193456, 0.001421929, -0.001314075),
        ),
        _mass(
            0.6271432862,
            (0.004522582, 0.008626192, -0.01616333),
            (0.0002109239, 0.0001771857, 5.993191e-05, -2.433299e-05, 4.56448e-05, 8.74407e-05),
        ),
    ),
    "fr3v2": (
        _mass(3.85, (-0.0172, 0.0004, 0.0745), (0.009, 0.0115, 0.0085, 0.0, 0.002, 0.0)),
        _mass(2.4377, (-0.00458, 0.027016, -0.0618), (0.02324, 0.02146, 0.0055, 0.000333, -0.000676, 0.003739)),
        _mass(2.2375, (-0.003473, -0.168509, -0.010479), (0.019026, 0.00566, 0.017114, 0.001241, 0.000499, -0.001804)),
        _mass(2.185794, (0.092968, 0.01801, 0.033533), (0.010225, 0.012398, 0.006877, 0.001144, 0.003497, 0.002156)),
        _mass(2.175867, (-0.068745, 0.092947, 0.011195), (0.008878, 0.007628, 0.010295, -0.003749, 0.001139, -0.00046)),
        _mass(
            2.174817, (-0.004197, 0.010257, -0.058103), (0.031874, 0.029674, 0.004751, 0.000134, -0.000265, -0.004734)
        ),
        _mass(1.567617, (0.070958, -0.014137, -0.035324), (0.00286, 0.00391, 0.00453, -0.000553, -0.000638, -0.00024)),
        _mass(0.682876, (0.008204, 0.001156, 0.061016), (0.000899, 0.001099, 0.000702, 0.0, -1.3e-05, -2.2e-05)),
    ),
}
"""Base and links 1 to 7 of each model, each in its own frame (`hw.kinematics`)."""

_X_7F = np.eye(4)
_X_7F[2, 3] = FLANGE_M


@dataclass(frozen=True, eq=False)
class Demand:
    """Joint torques and flange motion of samples of a motion; vectors are in the axes of the base."""

    torque_Nm: Array  # (..., 7)
    flange_m_s: Array  # (..., 3)
    flange_m_s2: Array  # (..., 3)
    flange_rad_s: Array  # (..., 3)
    flange_rad_s2: Array  # (..., 3)


def demand_of(model: str, q_rad: ArrayLike, dq_rad_s: ArrayLike, ddq_rad_s2: ArrayLike, load: Mass) -> Demand:
    """Joints, velocities and accelerations (..., 7) of the arm `model` with `load` (flange frame) -> torques and motion
    of the flange."""
    q, dq, ddq = (np.asarray(v, dtype=np.float64) for v in (q_rad, dq_rad_s, ddq_rad_s2))
    lead, links = q.shape[:-1], LINKS[model]
    poses = np.ascontiguousarray(np.moveaxis(link_poses(q.reshape(-1, JOINTS))[:, :, :3], 0, -1))  # (9, 3, 4, N)
    spins, turns, ups, speed = _forward(poses, dq.reshape(-1, JOINTS).T, ddq.reshape(-1, JOINTS).T)
    torque = _backward(poses, (*links[1:JOINTS], links[JOINTS] + load.placed(_X_7F)), spins, turns, ups)
    r = poses[FLANGE, :, 3] - poses[JOINTS, :, 3]
    acceleration = ups[-1] + _cross(turns[-1], r) + _cross(spins[-1], _cross(spins[-1], r))
    acceleration[2] -= GRAVITY_M_S2

    def shaped(v: Array) -> Array:
        return np.ascontiguousarray(v.T).reshape(*lead, len(v))

    return Demand(*map(shaped, (torque, speed + _cross(spins[-1], r), acceleration, spins[-1], turns[-1])))


def torque_Nm(model: str, q_rad: ArrayLike, dq_rad_s: ArrayLike, ddq_rad_s2: ArrayLike, load: Mass) -> Array:
    """Joints, velocities and accelerations (..., 7) -> torques (..., 7) of the arm `model` with `load` (flange)."""
    return demand_of(model, q_rad, dq_rad_s, ddq_rad_s2, load).torque_Nm


def _forward(poses: Array, dq: Array, ddq: Array) -> tuple[list[Array], list[Array], list[Array], Array]:
    """Angular velocity, angular acceleration and acceleration of the origin (3, N) of links 1 to 7, and the velocity of
    the last origin. Gravity counts as an acceleration of the base upwards."""
    n = poses.shape[-1]
    spin, turn, up, speed = (np.zeros((3, n)) for _ in range(4))
    up[2] = GRAVITY_M_S2
    spins, turns, ups = [], [], []
    for i in range(1, JOINTS + 1):
        r = poses[i, :, 3] - poses[i - 1, :, 3]
        around = _cross(spin, r)
        up = up + _cross(turn, r) + _cross(spin, around)
        speed = speed + around
        z = poses[i, :, 2]
        own = z * dq[i - 1]
        turn = turn + z * ddq[i - 1] + _cross(spin, own)
        spin = spin + own
        spins.append(spin)
        turns.append(turn)
        ups.append(up)
    return spins, turns, ups, speed


def _backward(
    poses: Array, bodies: tuple[Mass, ...], spins: list[Array], turns: list[Array], ups: list[Array]
) -> Array:
    """The torques (7, N), from the last link to the first."""
    n = poses.shape[-1]
    force, moment, torque = np.zeros((3, n)), np.zeros((3, n)), np.zeros((JOINTS, n))
    for i in range(JOINTS, 0, -1):
        if i < JOINTS:  # force and moment from the next link, about this link's origin
            moment = moment + _cross(poses[i + 1, :, 3] - poses[i, :, 3], force)
        body, R = bodies[i - 1], poses[i, :, :3]
        spin, turn, up = spins[i - 1], turns[i - 1], ups[i - 1]
        c = np.tensordot(R, body.com_m, axes=(1, 0))
        own = body.kg * (up + _cross(turn, c) + _cross(spin, _cross(spin, c)))
        moment = moment + _cross(c, own) + _inert(R, body.inertia_kg_m2, turn)
        moment = moment + _cross(spin, _inert(R, body.inertia_kg_m2, spin))
        force = force + own
        torque[i - 1] = _dot(poses[i, :, 2], moment)
    return torque


def _inert(R: Array, inertia: Array, v: Array) -> Array:
    """Inertia in the axes of a link, rotated by R (3, 3, N), times vectors (3, N) in the base."""
    inside = np.stack([_dot(R[:, k], v) for k in range(3)])
    turned = inertia @ inside
    return np.asarray(R[:, 0] * turned[0] + R[:, 1] * turned[1] + R[:, 2] * turned[2])


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


def _cross(a: Array, b: Array) -> Array:
    """The cross product of vectors (3, N)."""
    out = np.empty_like(a)
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]
    return out
