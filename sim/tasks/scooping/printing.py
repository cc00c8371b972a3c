"""What a lab prints for scooping: the adapter between the turner's handle and the fingers."""

from __future__ import annotations

import numpy as np

from sim.tasks.scooping.scene import ADAPTER_M, HANDLE_SECTION_M
from sim.tasks.shared.printing import box, cut, hole
from sim.types import Part

_FIT_M = 0.0004
"""The channel is this much wider than the handle; the halves are this far apart."""


def parts() -> tuple[Part, ...]:
    """One of two equal halves that clamp the handle, which lies along X. Raises ExtraMissing."""
    length, width, height = ADAPTER_M
    channel_y, channel_z = (side + _FIT_M for side in HANDLE_SECTION_M)
    half = box((length, width, height / 2 - _FIT_M / 2), (0.0, 0.0, -height / 4 - _FIT_M / 4))
    channel = box((2 * length, channel_y, channel_z), (0.0, 0.0, 0.0))
    y = (width + channel_y) / 4
    holes = [hole((0.32 * sx * length, sy * y, 0.0), height) for sx in (-1, 1) for sy in (-1, 1)]
    return (
        Part(
            name="adapter",
            solid=cut(half, channel, *holes),
            count=2,
            down=np.array([0.0, 0.0, -1.0]),
            held_m=width,
            notes=(
                "Four M3 x 35 screws with nuts clamp the handle between the halves.",
                "For a handle of {:.0f} x {:.0f} mm; tape fills a gap.".format(*(1e3 * s for s in HANDLE_SECTION_M)),
                "Weigh turner and adapter together, and write it into [tools.scooping.payload].",
            ),
        ),
    )
