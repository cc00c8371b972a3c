"""The sheet of the parts: what to print and how, a drawing of each with its dimensions, and the patch at true size."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure

from sim.tasks.shared.shapes import library, simplified
from sim.types import Part

OPENING_M = 0.08
"""Width between the fingers of a Franka Hand that is open (maker's data sheet)."""

PLA_KG_M3 = 1240.0
"""Density of solid PLA (data sheets of filaments)."""

A4_INCH = (8.27, 11.69)
SHARP_RAD = 0.3
"""Edges between faces that turn by more are drawn."""

FINEST_MM = 1e-3
"""Corners nearer together become one: slivers of a cut cross themselves in a file of 32-bit numbers."""

_VIEWS = (("from above", 0, 1), ("from the front", 0, 2), ("from the side", 1, 2))


def pdf(parts: Sequence[Part]) -> bytes:
    """One page of text, then a page for each part: its drawing, or its outline at true size."""
    out = io.BytesIO()
    with mpl.rc_context({"font.size": 9, "pdf.fonttype": 42}), PdfPages(out, metadata={"CreationDate": None}) as pages:
        for page in (_text(parts), *(_outline(part) if part.flat else _drawing(part) for part in parts)):
            pages.savefig(page)
    return out.getvalue()


def printed(part: Part) -> Any:
    """The solid (trimesh.Trimesh) in millimetres, as it lies on the printer's bed, z = 0."""
    turned = part.solid.copy()
    turned.apply_transform(library().geometry.align_vectors(part.down, [0.0, 0.0, -1.0]))
    turned.apply_scale(1e3)
    turned.apply_translation([*-turned.bounds.mean(axis=0)[:2], -turned.bounds[0, 2]])
    return simplified(turned, FINEST_MM)


def infill(part: Part) -> float | None:
    """Share of solid PLA with which a print has the mass that the scene knows."""
    return None if part.mass is None else part.mass.kg / (PLA_KG_M3 * float(part.solid.volume))


def lines(part: Part) -> tuple[str, ...]:
    """The facts of one part for a person."""
    size = printed(part).extents
    if part.flat:
        return (f"{part.name}: an outline of {size[0]:.1f} x {size[1]:.1f} mm on the sheet", *part.notes)
    rows = [
        f"{part.name}.stl, {part.count} x: {' x '.join(f'{side:.1f}' for side in size)} mm, "
        f"{1e6 * part.solid.volume:.1f} cm3"
    ]
    if part.held_m is not None:
        rows.append(f"between the fingers {1e3 * part.held_m:.0f} mm (the hand opens {1e3 * OPENING_M:.0f} mm)")
    if part.mass is not None:
        x, y, z = 1e3 * part.mass.com_m
        rows.append(
            f"the scene has {1e3 * part.mass.kg:.0f} g: {100 * (infill(part) or 0.0):.0f} % of solid PLA, walls "
            f"included; centre of mass ({x:.1f}, {y:.1f}, {z:.1f}) mm in the tool's frame"
        )
    return (*rows, *part.notes)


def _text(parts: Sequence[Part]) -> Figure:
    figure = Figure(figsize=A4_INCH)
    rows = [
        "Parts to print",
        "",
        "PLA or PETG, layers of 0.2 mm. Weigh each tool and write the mass into the rig file.",
        "",
    ]
    for part in parts:
        first, *others = lines(part)
        rows += [first, *(f"    {line}" for line in others), ""]
    rows += [
        "The calibration board: adaptsim calibrate board. Print outlines at 100 %, and measure their ruler.",
    ]
    figure.text(0.08, 0.95, "\n".join(rows), va="top", wrap=True, linespacing=1.5)
    return figure


def _drawing(part: Part) -> Figure:
    figure = Figure(figsize=A4_INCH)
    solid = printed(part)
    angles = solid.face_adjacency_angles
    edges = solid.vertices[solid.face_adjacency_edges[angles > SHARP_RAD]]
    figure.suptitle(f"{part.name}, as it lies on the printer's bed, mm")
    figure.subplots_adjust(hspace=0.5)
    for place, (name, u, v) in enumerate(_VIEWS, 1):
        axis = figure.add_subplot(3, 1, place)
        for edge in edges:
            axis.plot(edge[:, u], edge[:, v], color="black", linewidth=0.6)
        (left, low), (right, high) = solid.bounds[0][[u, v]], solid.bounds[1][[u, v]]
        off = 0.08 * max(right - left, high - low)
        for start, end in (((left, low - off), (right, low - off)), ((left - off, low), (left - off, high))):
            axis.annotate("", start, end, arrowprops={"arrowstyle": "<->", "shrinkA": 0, "shrinkB": 0})
        axis.text((left + right) / 2, low - 1.3 * off, f"{right - left:.1f}", ha="center", va="top")
        axis.text(left - 1.3 * off, (low + high) / 2, f"{high - low:.1f}", ha="right", va="center")
        axis.set(xlim=(left - 3 * off, right + off), ylim=(low - 2.5 * off, high + off))
        axis.set_aspect("equal")
        axis.set_title(name, fontsize=8)
        axis.axis("off")
    return figure


def _outline(part: Part) -> Figure:
    """An outline at true size on A4, with a ruler that checks the printer."""
    figure = Figure(figsize=A4_INCH)
    axis = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    width_mm, height_mm = (25.4 * side for side in A4_INCH)
    u, v = width_mm / 2, height_mm * 0.55
    half_u, half_v = printed(part).extents[:2] / 2
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]]) * [half_u, half_v] + [u, v]
    axis.plot(*corners.T, color="black", linewidth=0.8)
    axis.plot([u - 5, u + 5], [v, v], [u, u], [v - 5, v + 5], color="black", linewidth=0.5)
    caption = f"{part.name}, {2 * half_u:.0f} x {2 * half_v:.0f} mm: cut the material along this line"
    axis.text(u, v + half_v + 8, caption, ha="center")
    axis.text(u, v - half_v - 10, "; ".join(part.notes), ha="center")
    start = u - 50
    axis.plot([start, start + 100], [40, 40], color="black", linewidth=0.8)
    for tick in range(11):
        axis.plot([start + 10 * tick] * 2, [40, 43], color="black", linewidth=0.6)
    axis.text(
        u, 32, "100 mm: measure this line; if it is not 100 mm, print at 100 % without fitting to the page", ha="center"
    )
    axis.set(xlim=(0, width_mm), ylim=(0, height_mm))
    axis.axis("off")
    return figure
