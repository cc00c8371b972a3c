"""The sheet of the parts: what to print and how, a drawing of each with its dimensions, and the patch at true size."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from adaptsim_cli.screen.paper import A4_MM, Sheet
from sim.tasks.shared.shapes import library, simplified
from sim.types import Part

OPENING_M = 0.08
"""Width between the fingers of a Franka Hand that is open (maker's data sheet)."""

PLA_KG_M3 = 1240.0
"""Density of solid PLA (data sheets of filaments)."""

_MARGIN_MM = 17.0
_VIEW_MM = (176.0, 85.0)
SHARP_RAD = 0.3
"""Edges between faces that turn by more are drawn."""

FINEST_MM = 1e-3
"""Corners that are nearer together become one, because slivers of a cut would cross themselves in 32-bit numbers."""

_VIEWS = (("from above", 0, 1), ("from the front", 0, 2), ("from the side", 1, 2))


def pdf(parts: Sequence[Part]) -> bytes:
    """One page of text, then a page for each part: its drawing, or its outline at true size."""
    return Sheet.pdf([_text(parts), *(_outline(part) if part.flat else _drawing(part) for part in parts)])


def printed(part: Part) -> Any:
    """The solid (trimesh.Trimesh) in millimetres, as it lies on the printer's bed, z = 0."""
    turned = part.solid.copy()
    turned.apply_transform(library().geometry.align_vectors(part.down, [0.0, 0.0, -1.0]))
    turned.apply_scale(1e3)
    turned.apply_translation([*-turned.bounds.mean(axis=0)[:2], -turned.bounds[0, 2]])
    return simplified(turned, FINEST_MM)


def infill(part: Part) -> float | None:
    """The infill, as a share of solid PLA, that gives a print the mass assumed by the scene."""
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


def _text(parts: Sequence[Part]) -> Sheet:
    sheet = Sheet(*A4_MM)
    y_mm = sheet.height_mm - _MARGIN_MM
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
    for row in rows:
        indent_mm = 0.0 if row == row.lstrip() else 4.0
        room_mm = sheet.width_mm - 2.0 * _MARGIN_MM - indent_mm
        y_mm = sheet.paragraph(_MARGIN_MM + indent_mm, y_mm, room_mm, row.strip(), 9)
    return sheet


def _drawing(part: Part) -> Sheet:
    sheet = Sheet(*A4_MM)
    solid = printed(part)
    angles = solid.face_adjacency_angles
    edges = solid.vertices[solid.face_adjacency_edges[angles > SHARP_RAD]]
    middle_mm = sheet.width_mm / 2
    sheet.text(middle_mm, sheet.height_mm - _MARGIN_MM, f"{part.name}, as it lies on the printer's bed, mm", 11, "mt")
    for place, (name, u, v) in enumerate(_VIEWS):
        top_mm = sheet.height_mm - 30.0 - _VIEW_MM[1] * place
        sheet.text(middle_mm, top_mm, name, 8, "mt")
        low, high = solid.bounds[:, [u, v]]
        size = high - low
        scale = min((_VIEW_MM[0] - 30.0) / size[0], (_VIEW_MM[1] - 30.0) / size[1])
        shift = np.array([middle_mm, top_mm - 12.0 - scale * size[1] / 2]) - scale * (low + high) / 2
        for edge in edges:
            sheet.line(map(tuple, scale * edge[:, [u, v]] + shift), 0.2)
        (left, bottom), (right, top) = scale * low + shift, scale * high + shift
        sheet.dimension((left, bottom - 4.0), (right, bottom - 4.0), 0.2)
        sheet.dimension((left - 4.0, bottom), (left - 4.0, top), 0.2)
        sheet.text((left + right) / 2, bottom - 5.5, f"{size[0]:.1f}", 9, "mt")
        sheet.text(left - 5.5, (bottom + top) / 2, f"{size[1]:.1f}", 9, "rm")
    return sheet


def _outline(part: Part) -> Sheet:
    """An outline at true size on A4, with a ruler that checks the printer."""
    sheet = Sheet(*A4_MM)
    u, v = sheet.width_mm / 2, sheet.height_mm * 0.55
    half_u, half_v = printed(part).extents[:2] / 2
    corners = [(u + i * half_u, v + j * half_v) for i, j in ((-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1))]
    sheet.line(corners, 0.3)
    sheet.line([(u - 5, v), (u + 5, v)], 0.2)
    sheet.line([(u, v - 5), (u, v + 5)], 0.2)
    caption = f"{part.name}, {2 * half_u:.0f} x {2 * half_v:.0f} mm: cut the material along this line"
    sheet.text(u, v + half_v + 8, caption, 9, "mb")
    sheet.text(u, v - half_v - 10, "; ".join(part.notes), 9, "mt")
    start = u - 50
    sheet.line([(start, 40), (start + 100, 40)], 0.3)
    for tick in range(11):
        sheet.line([(start + 10 * tick, 40), (start + 10 * tick, 43)], 0.2)
    advice = "100 mm: measure this line; if it is not 100 mm, print at 100 % without fitting to the page"
    sheet.text(u, 34, advice, 9, "mt")
    return sheet
