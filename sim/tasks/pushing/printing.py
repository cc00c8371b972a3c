"""What a lab prints for pushing: the pusher, and the outline of the patch."""

from __future__ import annotations

import numpy as np

from sim.tasks.pushing.mass import TOOL_MASS
from sim.tasks.pushing.mount import BLOCK_M, GRIP_M, ROOT_M
from sim.tasks.pushing.params import PATCH_SIZE_M, PATCH_X_M
from sim.tasks.pushing.scene import pusher_visuals
from sim.tasks.shared.printing import box, cut, joined, library
from sim.types import Part

_ROOT_M = 0.02
"""The stem's end is oblique to the plate. As drawn, half of it would touch; the print's is this much longer."""


def parts() -> tuple[Part, ...]:
    """Plate, stem and block in one piece, in the tool frame T, and the patch. Raises ExtraMissing."""
    plate, stem, block = (library().Trimesh(one.vertices_m, one.triangles) for one in pusher_visuals("pusher"))
    root = stem.copy()
    root.apply_translation(_ROOT_M * (ROOT_M - GRIP_M) / np.linalg.norm(ROOT_M - GRIP_M))
    front = box((0.1, 0.4, 0.4), (0.05, 0.0, 0.0))
    pusher = Part(
        name="pusher",
        solid=cut(joined(plate, stem, root, block), front),
        down=np.array([1.0, 0.0, 0.0]),
        held_m=BLOCK_M[1],
        mass=TOOL_MASS,
        notes=(
            "Plate down, with supports under the stem, four walls.",
            "Wind two rubber bands around the lower half of the plate: they are part of the task's friction.",
        ),
    )
    patch = Part(
        name="patch",
        solid=box((PATCH_SIZE_M, PATCH_SIZE_M, 0.001), (0.0, 0.0, 0.0)),
        flat=True,
        notes=(f"its middle {PATCH_X_M:.2f} m ahead of the arm's foot, its edges along X and Y",),
    )
    return pusher, patch
