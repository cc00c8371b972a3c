"""The solids to print, from the numbers that scene, limits and masks use."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from hw.mass import Mass
from hw.types import Array
from sim.errors import ExtraMissing
from sim.lab.board import MARGIN_M
from sim.lab.board import THICKNESS_M as BOARD_THICKNESS_M
from sim.tasks.pushing import mass as pusher_mass
from sim.tasks.pushing.looks import pusher_visuals
from sim.tasks.pushing.mount import BLOCK_M, GRIP_M, ROOT_M
from sim.tasks.scooping.looks import ADAPTER_M, HANDLE_SECTION_M

if TYPE_CHECKING:
    import trimesh

OPENING_M = 0.08
"""Width between the fingers of a Franka Hand that is open (maker's data sheet)."""

PLA_KG_M3 = 1240.0
"""Density of solid PLA (data sheets of filaments)."""

FIT_M, SCREW_M = 0.0004, 0.0034
"""What a channel is wider than the handle in it; diameter of a through hole for M3."""

TAB_M = (0.03, 0.05)
"""Width and height of the board's tab between the fingers, as in the lab's scene (`sim.lab.board`)."""
_ROOT_M = 0.02  # of the pusher's stem, beyond its drawing
_RIB_M, _PAD_M, _LAP_M = 0.004, 0.04, 0.012  # thickness; height behind the board, and behind the tab


@dataclass(frozen=True, eq=False)
class Part:
    """One solid, in metres, in the frame that `frame` names."""

    name: str  # of the file
    solid: trimesh.Trimesh
    count: int
    frame: str
    down: Array  # (3,) direction that lies on the printer's bed
    held_m: float  # width between the fingers
    modelled: Mass | None  # that the scene knows, in the same frame; None: the scene knows none
    notes: tuple[str, ...]

    @property
    def infill(self) -> float | None:
        """Share of solid PLA with which a print has the modelled mass."""
        return None if self.modelled is None else self.modelled.kg / (PLA_KG_M3 * float(self.solid.volume))

    def printed(self) -> trimesh.Trimesh:
        """The solid in millimetres, as it lies on the printer's bed, z = 0."""
        turned = self.solid.copy()
        turned.apply_transform(_library().geometry.align_vectors(self.down, [0.0, 0.0, -1.0]))
        turned.apply_scale(1e3)
        turned.apply_translation([*-turned.bounds.mean(axis=0)[:2], -turned.bounds[0, 2]])
        return turned


def parts() -> tuple[Part, ...]:
    """Every part of a lab. Raises ExtraMissing without trimesh and manifold3d."""
    return pusher(), adapter(), holder()


def pusher() -> Part:
    """Plate, stem and block in one piece, in the tool frame T of pushing."""
    plate, stem, block = (_library().Trimesh(one.vertices_m, one.triangles) for one in pusher_visuals("pusher"))
    root = stem.copy()  # the stem's end is oblique to the plate: as drawn, half of it would touch
    root.apply_translation(_ROOT_M * (ROOT_M - GRIP_M) / np.linalg.norm(ROOT_M - GRIP_M))
    front = _box((0.1, 0.4, 0.4), (0.05, 0.0, 0.0))
    return Part(
        "pusher", _cut(_joined(plate, stem, root, block), front), 1, "T of pushing", np.array([1.0, 0.0, 0.0]),
        BLOCK_M[1], pusher_mass.TOOL_MASS,
        (
            "Plate down, with supports under the stem, four walls.",
            "Wind two rubber bands around the lower half of the plate: they are part of the task's friction.",
        ),
    )  # fmt: skip


def adapter() -> Part:
    """One of two equal halves that clamp the turner's handle; the handle lies along X, the fingers close along Y."""
    length, width, height = ADAPTER_M
    channel_y, channel_z = (side + FIT_M for side in HANDLE_SECTION_M)
    half = _box((length, width, height / 2 - FIT_M / 2), (0.0, 0.0, -height / 4 - FIT_M / 4))
    channel = _box((2 * length, channel_y, channel_z), (0.0, 0.0, 0.0))
    y = (width + channel_y) / 4
    holes = [_hole((sx * length * 0.32, sy * y, 0.0), height) for sx in (-1, 1) for sy in (-1, 1)]
    return Part(
        "adapter", _cut(half, channel, *holes), 2, "middle of the handle between the fingers",
        np.array([0.0, 0.0, -1.0]), width, None,
        (
            "Print two. Four M3 x 35 screws with nuts clamp the handle between them.",
            f"For a handle of {1e3 * HANDLE_SECTION_M[0]:.0f} x {1e3 * HANDLE_SECTION_M[1]:.0f} mm; tape fills a gap.",
            "Weigh turner and adapter together, and write it into [tools.scooping.payload].",
        ),
    )  # fmt: skip


def holder() -> Part:
    """The tab that holds the board, in a frame at the middle of the board's upper edge: X along it, Y down, Z back."""
    width, height = TAB_M
    above = height - MARGIN_M / 2
    tab = _box((width, above, BOARD_THICKNESS_M), (0.0, -above / 2, BOARD_THICKNESS_M / 2))
    rib_z = BOARD_THICKNESS_M + _RIB_M / 2
    rib = _box((width, _PAD_M + _LAP_M, _RIB_M), (0.0, (_PAD_M - _LAP_M) / 2, rib_z))
    holes = [_hole((0.0, share * _PAD_M, rib_z), _RIB_M) for share in (0.3, 0.8)]
    return Part(
        "board-holder", _cut(_joined(tab, rib), *holes), 1, "middle of the board's upper edge",
        np.array([1.0, 0.0, 0.0]), BOARD_THICKNESS_M, None,
        (
            "Lies on its side, no supports. The closed fingers hold the tab, its lower end just beyond them.",
            "Two M3 x 12 screws through the board, or glue, behind the middle of its upper edge.",
        ),
    )  # fmt: skip


def _library() -> Any:
    try:
        import manifold3d  # noqa: F401 - trimesh joins and cuts with it
        import trimesh
    except ImportError as error:
        raise ExtraMissing("parts need trimesh and manifold3d: pip install 'adaptsim[parts]'") from error
    return trimesh


def _box(size_m: tuple[float, ...], centre_m: tuple[float, float, float]) -> trimesh.Trimesh:
    X = np.eye(4)
    X[:3, 3] = centre_m
    return _library().creation.box(extents=size_m, transform=X)


def _hole(centre_m: tuple[float, float, float], length_m: float) -> trimesh.Trimesh:
    """A cylinder along Z."""
    X = np.eye(4)
    X[:3, 3] = centre_m
    return _library().creation.cylinder(radius=SCREW_M / 2, height=2 * length_m, sections=32, transform=X)


def _joined(*solids: trimesh.Trimesh) -> trimesh.Trimesh:
    return _library().boolean.union(solids, engine="manifold")


def _cut(solid: trimesh.Trimesh, *others: trimesh.Trimesh) -> trimesh.Trimesh:
    return _library().boolean.difference([solid, *others], engine="manifold")
