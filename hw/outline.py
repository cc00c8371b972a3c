"""Two models of arm and hand as capsules, in the frames of `hw.kinematics`; both hold for Panda, FR3 and FR3 v2.

`ARM`, `HAND` and `FINGERS` are the outline: together they contain every point of the maker's collision meshes of all
three arms, of the hand, and of the fingers at any opening. It is used for boxes, the person's side, the table and the
camera's mask. `benchmarks/outline.py` fitted it to the meshes of franka_description 566ba44 and measures the fit.

`COARSE_ARM` and `COARSE_HAND` are the maker's own capsules for self-collision (the same description,
robots/common/franka_arm.xacro and end_effectors/common/franka_hand.xacro). The real surface lies up to 44 mm outside of
them, so they are used for nothing else.
"""

from __future__ import annotations

import numpy as np

from hw.capsules import Capsule
from hw.kinematics import FLANGE

_Row = tuple[float, float, float, float, float, float, float]
"""Start, end, radius in m."""

_HALF_SQRT = float(np.sqrt(0.5))


def _capsule(name: str, link: int, start: tuple[float, ...], end: tuple[float, ...], radius: float) -> Capsule:
    return Capsule(name, link, np.array(start), np.array(end), radius)


def _rows(name: str, link: int, *rows: _Row) -> tuple[Capsule, ...]:
    return tuple(_capsule(name, link, row[:3], row[3:6], row[6]) for row in rows)


ARM: tuple[Capsule, ...] = (
    *_rows(
        "base",
        0,
        (-0.0026, -0.0523, 0.0332, -0.1106, -0.0265, 0.0268, 0.0572),
        (-0.1100, 0.0235, 0.0265, -0.0004, 0.0505, 0.0340, 0.0596),
        (0.0030, -0.0025, 0.0568, -0.0162, -0.0017, 0.0902, 0.0922),
    ),
    *_rows(
        "link 1",
        1,
        (-0.0002, -0.0263, 0.0030, -0.0001, -0.0020, -0.1546, 0.0623),
        (-0.0009, 0.0000, -0.1757, -0.0002, -0.0780, 0.0038, 0.0599),
    ),
    *_rows(
        "link 2",
        2,
        (-0.0003, -0.1536, 0.0021, 0.0002, 0.0043, 0.0267, 0.0621),
        (0.0003, -0.1786, -0.0006, -0.0002, 0.0012, 0.0766, 0.0599),
    ),
    *_rows(
        "link 3",
        3,
        (0.0890, 0.0198, -0.0043, -0.0000, -0.0086, -0.1081, 0.0563),
        (0.0852, 0.0120, 0.0070, 0.0016, -0.0061, -0.0457, 0.0554),
        (0.0797, 0.0610, 0.0021, -0.0078, 0.0013, -0.0976, 0.0611),
    ),
    *_rows(
        "link 4",
        4,
        (-0.0824, 0.1005, 0.0000, -0.0136, 0.0264, 0.0248, 0.0619),
        (0.0068, -0.0062, 0.0167, -0.0796, 0.0576, -0.0048, 0.0586),
        (-0.0721, 0.0701, 0.0245, -0.0018, 0.0001, 0.0589, 0.0610),
    ),
    *_rows(
        "link 5",
        5,
        (0.0001, 0.0171, -0.0069, -0.0003, 0.0836, -0.0001, 0.0566),
        (0.0003, 0.0413, -0.0479, -0.0002, -0.0002, -0.2587, 0.0610),
        (0.0006, 0.0365, -0.1948, 0.0003, 0.0777, -0.0197, 0.0563),
    ),
    *_rows(
        "link 6",
        6,
        (0.0106, 0.0114, 0.0101, 0.0812, 0.0401, -0.0004, 0.0509),
        (0.0850, 0.0274, -0.0001, 0.0853, -0.0465, -0.0012, 0.0493),
        (0.0003, 0.0010, 0.0076, 0.0647, -0.0121, 0.0042, 0.0561),
    ),
    *_rows(
        "link 7",
        7,
        (0.0116, -0.0165, 0.0626, 0.0540, 0.0364, 0.0882, 0.0298),
        (-0.0194, 0.0107, 0.0603, 0.0373, 0.0559, 0.0887, 0.0287),
        (0.0100, 0.0097, 0.0812, -0.0055, -0.0059, 0.0775, 0.0484),
    ),
)
"""The links' outline. It lies at most 12.3 mm outside of the meshes of a link, and 35 mm outside of those of the base.
"""

HAND: tuple[Capsule, ...] = _rows(
    "hand",
    FLANGE,
    (0.0500, 0.0500, 0.0158, -0.0250, -0.0252, 0.0052, 0.0362),
    (-0.0451, -0.0439, 0.0518, -0.0437, -0.0438, -0.0049, 0.0256),
    (-0.0587, -0.0591, 0.0499, -0.0572, -0.0570, -0.0033, 0.0251),
    (0.0564, 0.0566, 0.0434, -0.0396, -0.0397, 0.0410, 0.0308),
)
"""The hand without its fingers; at most 11.4 mm outside of the mesh."""

FINGERS: tuple[Capsule, ...] = _rows(
    "fingers",
    FLANGE,
    (0.0336, 0.0334, 0.1001, -0.0343, -0.0342, 0.0994, 0.0180),
    (0.0388, 0.0391, 0.0716, -0.0403, -0.0398, 0.0712, 0.0204),
)
"""The fingers at every opening up to 80 mm; at most 12.9 mm outside of these."""

COARSE_ARM: tuple[Capsule, ...] = (
    _capsule("base", 0, (-0.09, 0.0, 0.06), (-0.06, 0.0, 0.06), 0.06),
    _capsule("link 1", 1, (0.0, 0.0, -0.333), (0.0, 0.0, -0.05), 0.06),
    _capsule("link 2", 2, (0.0, 0.0, -0.06), (0.0, 0.0, 0.06), 0.06),
    _capsule("link 3", 3, (0.0, 0.0, -0.22), (0.0, 0.0, -0.07), 0.06),
    _capsule("link 4", 4, (0.0, 0.0, -0.06), (0.0, 0.0, 0.06), 0.06),
    _capsule("link 5", 5, (0.0, 0.0, -0.31), (0.0, 0.0, -0.21), 0.06),
    _capsule("forearm", 5, (0.0, 0.08, -0.20), (0.0, 0.08, -0.06), 0.025),
    _capsule("link 6", 6, (0.0, 0.0, -0.07), (0.0, 0.0, 0.01), 0.05),
    _capsule("link 7", 7, (0.0, 0.0, -0.06), (0.0, 0.0, 0.08), 0.04),
    _capsule(
        "guide button",
        7,
        (0.055 * _HALF_SQRT, 0.055 * _HALF_SQRT, 0.082),
        (0.065 * _HALF_SQRT, 0.065 * _HALF_SQRT, 0.082),
        0.03,
    ),
)
"""The maker turns those of link 7 by 45° about Z."""

_Y_M = 0.05 * _HALF_SQRT  # the hand is mounted turned by -45°: its Y axis lies between X and Y of the flange

COARSE_HAND: tuple[Capsule, ...] = (
    _capsule("hand", FLANGE, (-_Y_M, -_Y_M, 0.04), (_Y_M, _Y_M, 0.04), 0.04),
    _capsule("fingers", FLANGE, (-_Y_M, -_Y_M, 0.10), (_Y_M, _Y_M, 0.10), 0.02),
)
