"""Sheets of paper at true scale, as PDF or PNG: lines, text and pictures in millimetres, from the lower left corner."""

from __future__ import annotations

import io
from collections.abc import Iterable

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw, ImageFont

PX_MM = 20
"""Pixels in a millimetre: every paper, and every square of whole millimetres, has whole pixels."""
DPI = 25.4 * PX_MM
POINT_MM = 25.4 / 72.0
A4_MM = (210.0, 297.0)


class Sheet:
    """One sheet in black and white."""

    def __init__(self, width_mm: float, height_mm: float) -> None:
        self.width_mm, self.height_mm = width_mm, height_mm
        self._image = Image.new("1", (round(width_mm * PX_MM), round(height_mm * PX_MM)), 1)
        self._draw = ImageDraw.Draw(self._image)

    def line(self, points_mm: Iterable[tuple[float, float]], width_mm: float) -> None:
        """A line through points (x, y)."""
        self._draw.line([self._px(x, y) for x, y in points_mm], fill=0, width=max(1, round(width_mm * PX_MM)))

    def dimension(self, start_mm: tuple[float, float], end_mm: tuple[float, float], width_mm: float) -> None:
        """A line with an arrow at each end."""
        ends = np.array([start_mm, end_mm])
        along = (ends[1] - ends[0]) / max(float(np.linalg.norm(ends[1] - ends[0])), 1e-9)
        across = np.array([-along[1], along[0]])
        self.line(map(tuple, ends), width_mm)
        for tip, inwards in zip(ends, (along, -along), strict=True):
            for side in (across, -across):
                self.line([tuple(tip), tuple(tip + 2.0 * inwards + 0.7 * side)], width_mm)

    def text(self, x_mm: float, y_mm: float, text: str, points: float, anchor: str = "lt") -> None:
        """A line of ASCII text (the font has no more), its size in points.

        `anchor` is Pillow's: left, middle or right, then top, middle or bottom.
        """
        self._draw.text(self._px(x_mm, y_mm), text, fill=0, font=_font(points), anchor=anchor)

    def paragraph(self, x_mm: float, y_mm: float, width_mm: float, text: str, points: float) -> float:
        """Text that is broken at a width; returns the height (mm) at which the next paragraph starts."""
        font, lines = _font(points), [""]
        for word in text.split(" "):
            longer = f"{lines[-1]} {word}" if lines[-1] else word
            if font.getlength(longer) > width_mm * PX_MM and lines[-1]:
                lines.append(word)
            else:
                lines[-1] = longer
        for line in lines:
            self.text(x_mm, y_mm, line, points, "ls")
            y_mm -= 1.5 * points * POINT_MM
        return y_mm

    def picture(
        self, picture: npt.NDArray[np.uint8], left_mm: float, bottom_mm: float, width_mm: float, height_mm: float
    ) -> None:
        """A grey picture (H, W) of black and white areas, with sharp edges."""
        size = round(width_mm * PX_MM), round(height_mm * PX_MM)
        scaled = Image.fromarray(picture).resize(size, Image.Resampling.NEAREST)
        self._image.paste(scaled.point(lambda grey: 255 * (grey > 127), "1"), self._px(left_mm, bottom_mm + height_mm))

    def _px(self, x_mm: float, y_mm: float) -> tuple[int, int]:
        return round(x_mm * PX_MM), round((self.height_mm - y_mm) * PX_MM)

    @staticmethod
    def pdf(sheets: Iterable[Sheet]) -> bytes:
        """A page for each sheet, without a date, so that equal sheets are equal files."""
        first, *others = (sheet._image for sheet in sheets)
        out = io.BytesIO()
        first.save(
            out,
            "PDF",
            save_all=True,
            append_images=others,
            resolution=DPI,
            creationDate=None,
            modDate=None,
            producer=None,
        )
        return out.getvalue()

    def png(self) -> bytes:
        """The sheet as a picture that says its scale."""
        out = io.BytesIO()
        self._image.save(out, "PNG", dpi=(DPI, DPI))
        return out.getvalue()


def _font(points: float) -> ImageFont.FreeTypeFont:
    font = ImageFont.load_default(points * POINT_MM * PX_MM)
    if not isinstance(font, ImageFont.FreeTypeFont):
        raise TypeError("Pillow was built without FreeType, so it cannot write on a sheet: install its wheel")
    return font
