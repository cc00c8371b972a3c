"""The maker's collision meshes of all arms, hand and fingers, as points in the frames of the links: the true surface.

For judges that share nothing with `hw`: the file's triangles are placed with numbers of the robot description alone
(tests/data/franka-description). Link frames are those of the description, which are the Craig frames of
`hw.kinematics` and `own_judge`: 0 the base, 1 to 7 the links, 8 the flange.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

FOLDER = Path(__file__).parents[1] / "data" / "franka-description"
MODELS = {"panda": "fer", "fr3": "fr3", "fr3v2": "fr3v2"}
"""Name of an arm here -> its folder in the maker's description."""

FLANGE = 8
HAND_TURN_RAD = -np.pi / 4
"""The description mounts the hand on the flange turned by this about Z."""

FINGER = (
    ((0.022, 0.015, 0.020), (0.0, 0.0185, 0.011), 0.0),
    ((0.022, 0.0088, 0.0038), (0.0, 0.0068, 0.0022), 0.0),
    ((0.0175, 0.007, 0.0235), (0.0, 0.0159, 0.02835), np.pi / 6),
    ((0.0175, 0.0152, 0.0185), (0.0, 0.00758, 0.04525), 0.0),
)
"""The description's boxes of a finger in its own frame: edges and centre in m, turn about X in rad."""
FINGER_JOINT_M = 0.0584
"""From the flange to the fingers' frames along Z. Each finger moves along Y of the hand, by half of the opening."""

_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


@dataclass(frozen=True, eq=False)
class Body:
    """One mesh, fixed to a link."""

    name: str  # "link 3", "hand"
    link: int  # 0 the base, 1 to 7 the links, 8 the flange
    triangles_m: Array  # (T, 3, 3) corners in the link's frame

    def points_m(self, spacing_m: float) -> Array:
        """(P, 3) points of the surface, corners included, so dense that each point of it lies within `spacing_m`."""
        return np.unique(_halved(self.triangles_m, spacing_m).reshape(-1, 3).round(7), axis=0)


@cache
def bodies(model: str, opening_m: float = 0.0) -> tuple[Body, ...]:
    """Base, links 1 to 7, hand and both fingers of an arm (a key of `MODELS`); the fingers are `opening_m` apart."""
    links = (Body(f"link {i}", i, _triangles(FOLDER / MODELS[model] / f"link{i}.stl")) for i in range(8))
    turn = _about_z(HAND_TURN_RAD)
    hand = Body("hand", FLANGE, _triangles(FOLDER / "hand.stl") @ turn.T)
    origin_m = np.array([0.0, opening_m / 2.0, FINGER_JOINT_M])
    finger = np.concatenate([_box(*box) for box in FINGER]) + origin_m
    left, right = finger @ turn.T, finger @ _about_z(np.pi).T @ turn.T
    return (*links, hand, Body("left finger", FLANGE, left), Body("right finger", FLANGE, right))


def placed(points_m: Array, X_BL: Array) -> Array:
    """Points (P, 3) of a link at poses (..., 4, 4) -> (..., P, 3) in the base."""
    return np.asarray(points_m @ np.swapaxes(X_BL[..., :3, :3], -1, -2) + X_BL[..., None, :3, 3])


def _halved(triangles_m: Array, longest_m: float) -> Array:
    """The same surface of triangles (T, 3, 3) without an edge above `longest_m`: longer ones are cut in the middle."""
    whole, rest = [], triangles_m
    while len(rest):
        edges_m = np.linalg.norm(rest - np.roll(rest, -1, axis=1), axis=2)  # from each corner to the next
        whole.append(rest[edges_m.max(axis=1) <= longest_m])
        long = edges_m.max(axis=1) > longest_m
        rows = np.arange(long.sum())
        a, b, c = (rest[long][rows, (edges_m[long].argmax(axis=1) + k) % 3] for k in range(3))
        middle = (a + b) / 2.0
        rest = np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
    return np.concatenate(whole)


def _about_z(turn_rad: float) -> Array:
    cos, sin = np.cos(turn_rad), np.sin(turn_rad)
    return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])


def _box(size_m: tuple[float, ...], centre_m: tuple[float, ...], turn_rad: float) -> Array:
    """(12, 3, 3) triangles of a box, turned about X through its centre."""
    cos, sin = np.cos(turn_rad), np.sin(turn_rad)
    turn = np.array([[1.0, 0.0, 0.0], [0.0, cos, -sin], [0.0, sin, cos]])
    faces = []
    for axis in range(3):
        for side in (-1.0, 1.0):
            corners = np.insert(np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]), axis, side, axis=1)
            faces += [corners[[0, 1, 2]], corners[[0, 2, 3]]]
    return np.asarray(np.stack(faces) * np.array(size_m) / 2.0 @ turn.T + np.array(centre_m))


def _triangles(path: Path) -> Array:
    """(T, 3, 3) of a binary STL file: 80 bytes, the number of triangles, 50 bytes each."""
    content = path.read_bytes()
    count = int.from_bytes(content[80:84], "little")
    if len(content) != 84 + count * _TRIANGLE.itemsize:
        raise ValueError(f"{path} is no binary STL file of {count} triangles")
    return np.asarray(np.frombuffer(content, _TRIANGLE, count, 84)["corners"], dtype=np.float64)
