"""The tab by which the hand holds the calibration board, to print."""

from __future__ import annotations

import numpy as np

from sim.lab.board import MARGIN_M, TAB_M, THICKNESS_M
from sim.tasks.shared.printing import box, cut, hole, joined
from sim.types import Part

_RIB_M, _PAD_M, _LAP_M = 0.004, 0.04, 0.012  # thickness; height behind the board, and behind the tab


def holder() -> Part:
    """Frame: the middle of the board's upper edge, X along it, Y down, Z back. Raises ExtraMissing."""
    width, height = TAB_M
    above = height - MARGIN_M / 2
    tab = box((width, above, THICKNESS_M), (0.0, -above / 2, THICKNESS_M / 2))
    rib_z = THICKNESS_M + _RIB_M / 2
    rib = box((width, _PAD_M + _LAP_M, _RIB_M), (0.0, (_PAD_M - _LAP_M) / 2, rib_z))
    holes = [hole((0.0, share * _PAD_M, rib_z), _RIB_M) for share in (0.3, 0.8)]
    return Part(
        name="board-holder",
        solid=cut(joined(tab, rib), *holes),
        down=np.array([1.0, 0.0, 0.0]),
        held_m=THICKNESS_M,
        notes=(
            "Lies on its side, no supports. The closed fingers hold the tab, its lower end just beyond them.",
            "Two M3 x 12 screws through the board, or glue, behind the middle of its upper edge.",
        ),
    )
