"""Solids to print: boxes and holes that are joined and cut, and the two facts of hand and plastic behind them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from sim.errors import ExtraMissing

if TYPE_CHECKING:
    import trimesh

SCREW_M = 0.0034
"""Diameter of a through hole for M3."""


def library() -> Any:
    """The module trimesh. Raises ExtraMissing without it or manifold3d."""
    try:
        import manifold3d  # noqa: F401, PLC0415 - an extra; trimesh joins and cuts with it
        import trimesh  # noqa: PLC0415
    except ImportError as error:
        raise ExtraMissing("parts need trimesh and manifold3d: pip install 'adaptsim[parts]'") from error
    return trimesh


def box(size_m: tuple[float, ...], centre_m: tuple[float, float, float]) -> trimesh.Trimesh:
    """A box along the axes."""
    X = np.eye(4)
    X[:3, 3] = centre_m
    return library().creation.box(extents=size_m, transform=X)


def hole(centre_m: tuple[float, float, float], length_m: float) -> trimesh.Trimesh:
    """A cylinder along Z, for a screw of M3, to cut."""
    X = np.eye(4)
    X[:3, 3] = centre_m
    return library().creation.cylinder(radius=SCREW_M / 2, height=2 * length_m, sections=32, transform=X)


def joined(*solids: trimesh.Trimesh) -> trimesh.Trimesh:
    """All of them as one solid."""
    return library().boolean.union(solids, engine="manifold")


def cut(solid: trimesh.Trimesh, *others: trimesh.Trimesh) -> trimesh.Trimesh:
    """The solid without the others."""
    return library().boolean.difference([solid, *others], engine="manifold")
