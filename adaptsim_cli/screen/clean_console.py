"""rich's console for texts from anywhere: no control character acts, and no value is parted from its unit."""

from __future__ import annotations

import re
from collections.abc import Iterable

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment
from rich.text import Text

_COMMANDS = re.compile(r"[\x00-\x09\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")

_NUMBER = r"[+−-]?\d+(?:\.\d+)?(?:e-?\d+)?"
_BASE = r"(?:[kMm]?(?:Pa|Hz|m|N|B|W)|[mµn]?s|GB|cm|µm|m?rad|deg|°C?|k?g|min|h|px|%|V)[²³]?"
_UNIT = rf"{_BASE}(?:[ ·/]{_BASE})*(?![\w°%/·])"
_VALUE = rf"{_NUMBER} {_UNIT}"
_TOGETHER = re.compile(rf"(?<![\w.])(?:{_NUMBER} ± (?:{_VALUE}|{_NUMBER})|{_VALUE})|\S*\N{{NO-BREAK SPACE}}.*?(?= |$)")
"""A value with its deviation and unit, such as `0.29 ± 0.03 rad`, and words around no-break spaces."""

_SPACE = "\ue000"
"""Stands for a space inside a value while rich breaks lines: rich breaks at every real space, no-break ones too."""


class CleanConsole(Console):
    """rich's console. Control characters in a text become visible, and a value stays on one line with its unit."""

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """See rich. Control segments of rich itself (a progress bar's) stay."""
        if isinstance(renderable, str):
            renderable = Text(renderable)
        if isinstance(renderable, Text):
            renderable = _held_together(renderable, (options or self.options).max_width)
        for segment in super().render(renderable, options):
            if segment.control:
                yield segment
            else:
                yield Segment(clean(segment.text.replace(_SPACE, " ")), segment.style)


def clean(text: str) -> str:
    """The text with every control character but the line break made visible, as \\x1b."""
    return _COMMANDS.sub(lambda match: match.group().encode("unicode_escape").decode(), text)


def _held_together(text: Text, width: int) -> Text:
    """The text with `_SPACE` inside each value that fits the width."""

    def held(match: re.Match[str]) -> str:
        return re.sub(r"\s", _SPACE, match[0]) if len(match[0]) <= width else match[0]

    whole = text.copy()
    whole.plain = "\n".join(_TOGETHER.sub(held, line) for line in text.plain.split("\n"))
    return whole
