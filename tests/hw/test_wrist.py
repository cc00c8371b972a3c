"""The looks of arm and hand: the visual meshes that franky-sim ships, with the outline and the tight shapes."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import franky_sim
import numpy as np
import pytest
from capsule_gaps import outside_m

from hw.kinematics import FLANGE
from hw.outline import ARM, FINGERS, HAND
from hw.types import Array
from hw.wrist import FINGERTIP_M, X_FH

MESHES = Path(franky_sim.__file__).parent / "assets" / "meshes"
LOOKS_M = 0.001
FINGER_JOINT_M = 0.0584


@cache
def vertices(name: str) -> Array:
    """(V, 3) every fifth vertex of the meshes of a link, in its frame."""
    lines = [line for path in sorted(MESHES.glob(f"{name}_*vis.obj")) for line in path.read_text().splitlines()]
    return np.array([[float(v) for v in line.split()[1:4]] for line in lines if line.startswith("v ")])[::5]


def placed(name: str) -> tuple[int, Array]:
    """The link, and the vertices in its frame."""
    if name not in ("hand", "finger"):
        return int(name[-1]), vertices(name)
    off = np.array([0.0, 0.0, FINGER_JOINT_M if name == "finger" else 0.0])
    return FLANGE, (vertices(name) + off) @ X_FH[:3, :3].T


@pytest.mark.parametrize("name", ["hand", "finger", *(f"link{n}" for n in range(8))])
def test_the_outline_contains_the_looks(name: str) -> None:
    """Finer meshes of an FR3 than the maker's collision meshes, to which the outline was fitted."""
    link, at_m = placed(name)
    assert outside_m(at_m, tuple(c for c in (*ARM, *HAND, *FINGERS) if c.link == link)).max() < LOOKS_M


def test_the_fingers_end_where_their_mesh_ends() -> None:
    assert vertices("finger")[:, 2].max() + FINGER_JOINT_M == pytest.approx(FINGERTIP_M, abs=2e-4)
