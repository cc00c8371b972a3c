"""The arm's pose of a view, in any common convention, which is stated by the key or by `[poses]`, or recognised.

A key with unit and order in its name (`q_deg`, `position_mm`, `quaternion_xyzw`) is read as named. Any other (`joints`,
`position`, `quaternion`, `matrix`, ...) is read as `[poses]` of setup.toml states. If that does not state it, every
reading is tried (`calib.foreign.conventions`), and the recognised one is reported.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Self

import numpy as np
from pydantic import Field, model_validator
from scipy.spatial.transform import Rotation

from calib.types import Matrix, Numbers
from hw.poses import inverse
from hw.records import Record
from hw.types import Array

LENGTHS_M = {"m": 1.0, "mm": 1e-3}
ANGLES_RAD = {"rad": 1.0, "deg": float(np.pi / 180)}
EULER = ("xyz", "ZYX", "XYZ", "zyx", "ZYZ", "zyz")
"""Orders to try, in scipy's letters: small letters are rotations about the base's axes, capitals about the rotated
ones."""

LARGEST = 1e6
_ONE_OF = (
    "q_rad, q_deg, joints, X_BF, matrix, or a position with a rotation (position_m, position_mm or position, with"
    " quaternion_wxyz, quaternion_xyzw, quaternion, rotation_vector or euler)"
)


@dataclass(frozen=True)
class Convention:
    """One reading of the keys that do not state their convention."""

    length: str = "m"  # of LENGTHS_M
    angle: str = "rad"  # of ANGLES_RAD
    quaternion: str = "wxyz"  # or xyzw
    euler: str = "xyz"  # scipy's letters
    gives: str = "flange_in_base"  # or base_in_flange


class PosesRecord(Record):
    """`[poses]` of setup.toml: the convention of keys that do not state it themselves."""

    length: Literal["m", "mm"] | None = None  # of position and matrix
    angle: Literal["rad", "deg"] | None = None  # of joints, rotation_vector and euler
    quaternion: Literal["wxyz", "xyzw"] | None = None  # order of quaternion
    euler: str | None = Field(default=None, pattern="^([xyz]{3}|[XYZ]{3})$")  # small: about the base's axes
    gives: Literal["flange_in_base", "base_in_flange"] | None = None  # the direction of position and matrix


class PoseKeys(Record):
    """The part of a view that states the arm's pose."""

    q_rad: Numbers | None = None  # reported joints
    q_deg: Numbers | None = None  # the same in degrees
    joints: Numbers | None = None  # the same, in the unit stated by [poses] or recognised
    X_BF: Matrix | None = None  # the flange in the base, four rows of four, metres
    matrix: Matrix | None = None  # a pose, four rows of four, as stated by [poses] or recognised
    position_m: Numbers | None = None  # of the flange in the base, with a rotation: another way to give X_BF
    position_mm: Numbers | None = None  # the same in mm
    position: Numbers | None = None  # the same, in the unit stated by [poses] or recognised
    quaternion_wxyz: Numbers | None = None  # of the flange in the base, w first
    quaternion_xyzw: Numbers | None = None  # w last
    quaternion: Numbers | None = None  # in the order stated by [poses] or recognised
    rotation_vector: Numbers | None = None  # axis times angle
    euler: Numbers | None = None  # three angles, about the axes stated by [poses] or recognised

    @model_validator(mode="after")
    def _one_pose(self) -> Self:
        places, turns = self._given("position_m", "position_mm", "position"), self._rotations()
        for name in self._given(*PoseKeys.model_fields):
            if (most := float(np.abs(np.ravel(getattr(self, name))).max(initial=0.0))) > LARGEST:
                raise ValueError(f"{name} holds {most:g}: no pose has such a number")
        if len(self._given("q_rad", "q_deg", "joints", "X_BF", "matrix")) + len(places) != 1 or len(turns) > 1:
            raise ValueError(f"give exactly one of {_ONE_OF}")
        if bool(places) != bool(turns):
            raise ValueError("position and rotation are needed together, for example position_m and quaternion_wxyz")
        if not self.questions():
            self.flange()  # checks the keys
        return self

    def _given(self, *names: str) -> list[str]:
        return [name for name in names if getattr(self, name) is not None]

    def _rotations(self) -> list[str]:
        return self._given("quaternion_wxyz", "quaternion_xyzw", "quaternion", "rotation_vector", "euler")

    @property
    def has_joints(self) -> bool:
        """Whether the view gives joints instead of a pose."""
        return bool(self._given("q_rad", "q_deg", "joints"))

    def questions(self) -> frozenset[str]:
        """The fields of `Convention` on which the reading depends."""
        depends = {
            "joints": {"angle"},
            "matrix": {"length", "gives"},
            "position": {"length", "gives"},
            "quaternion": {"quaternion"},
            "rotation_vector": {"angle"},
            "euler": {"angle", "euler"},
        }
        return frozenset().union(*(fields for key, fields in depends.items() if getattr(self, key) is not None))

    def joints_rad(self, convention: Convention | None = None) -> Array | None:
        """(n,) if given, else None. Raises ValueError for numbers that look like degrees."""
        if self.q_deg is not None:
            return _row([ANGLES_RAD["deg"] * q for q in self.q_deg])
        if self.joints is not None:
            factor = ANGLES_RAD[(convention or Convention()).angle]
            return _row([factor * q for q in self.joints])
        if self.q_rad is not None and max(map(abs, self.q_rad)) > 7.0:
            raise ValueError(f"q_rad holds {max(map(abs, self.q_rad)):g}: joints are in rad, not in degrees")
        return None if self.q_rad is None else np.array(self.q_rad)

    def flange(self, convention: Convention | None = None) -> Array | None:
        """X_BF (4, 4) if given, else None.

        Raises ValueError for numbers that are not a pose, or look like millimetres or degrees.
        """
        how = convention or Convention()
        if self.has_joints:
            self.joints_rad(how)
            return None
        X = np.eye(4)
        rows = self.X_BF if self.X_BF is not None else self.matrix
        if rows is not None:
            if np.shape(rows) != (4, 4) or rows[3] != (0.0, 0.0, 0.0, 1.0):
                raise ValueError("X_BF must have four rows of four numbers, the last one 0 0 0 1")
            X = np.array(rows, dtype=np.float64)
            X[:3, 3] *= 1.0 if self.matrix is None else LENGTHS_M[how.length]
        else:
            X[:3, :3], X[:3, 3] = self._turn(how), self._position(how)
        if np.abs(X[:3, :3] @ X[:3, :3].T - np.eye(3)).max() > 1e-3 or np.linalg.det(X[:3, :3]) < 0:
            raise ValueError(
                "the rotation is not valid: its axes must have length 1, be at right angles and right-handed"
            )
        if np.linalg.norm(X[:3, 3]) > 10.0:
            raise ValueError(
                f"the flange is {np.linalg.norm(X[:3, 3]):g} m from the base: positions are in metres, not mm"
            )
        u, _, vt = np.linalg.svd(X[:3, :3])
        X[:3, :3] = u @ vt
        says_itself = not {"gives"} & self.questions()
        return X if says_itself or how.gives == "flange_in_base" else inverse(X)

    def _position(self, how: Convention) -> Array:
        factors = {"position_m": 1.0, "position_mm": 1e-3, "position": LENGTHS_M[how.length]}
        key = next(name for name in factors if getattr(self, name) is not None)
        values = getattr(self, key)
        if len(values) != 3:
            raise ValueError(f"{key} must have three numbers")
        return factors[key] * np.array(values, dtype=np.float64)

    def _turn(self, how: Convention) -> Array:
        if self.rotation_vector is not None or self.euler is not None:
            values = np.array(self.rotation_vector if self.euler is None else self.euler)
            if len(values) != 3:
                raise ValueError("rotation_vector and euler must have three numbers")
            values = ANGLES_RAD[how.angle] * values
            turn = Rotation.from_rotvec(values) if self.euler is None else Rotation.from_euler(how.euler, values)
            return np.asarray(turn.as_matrix())
        orders = {"quaternion_wxyz": "wxyz", "quaternion_xyzw": "xyzw", "quaternion": how.quaternion}
        key = next(name for name in orders if getattr(self, name) is not None)
        values = np.array(getattr(self, key))
        if len(values) != 4 or abs(np.linalg.norm(values) - 1) > 1e-2:
            raise ValueError(
                f"{key} must have four numbers, of length 1 together, with w first or last as the name says"
            )
        xyzw = values if orders[key] == "xyzw" else np.roll(values, -1)
        return np.asarray(Rotation.from_quat(xyzw).as_matrix())


def _row(values: Sequence[float]) -> Array:
    return np.array(values, dtype=np.float64)
