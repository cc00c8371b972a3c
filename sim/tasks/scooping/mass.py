"""The mass of the turner, in its frame T.

The total is that of the example rig file (docs/guide/rig.md, `[tools.scooping.payload]`). The blade has the mass of the
scene; the rest is spread evenly along neck and handle.
"""

from __future__ import annotations

from hw.mass import bar, box
from perception.blade import BLADE_LENGTH_M, BLADE_WIDTH_M
from sim.tasks.scooping.handle import HANDLE_M, NECK_M, ROOT_M, UP
from sim.tasks.scooping.params import EDGE_M
from sim.tasks.scooping.scene import BLADE_MASS_KG

TURNER_KG = 0.12
_HANDLE_EDGE_M = 0.02

TOOL_MASS = box(BLADE_MASS_KG, (BLADE_LENGTH_M, BLADE_WIDTH_M, EDGE_M), (-BLADE_LENGTH_M / 2, 0.0, -EDGE_M / 2)) + bar(
    TURNER_KG - BLADE_MASS_KG, ROOT_M, ROOT_M + (NECK_M + HANDLE_M) * UP, _HANDLE_EDGE_M
)
