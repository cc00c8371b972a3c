"""A console to which no text from a file or a device can send commands.

A note, a name or a message may hold escape sequences, which a terminal obeys: it would move the cursor, hide lines or
answer with keys. Here they are written out as visible characters.
"""

from __future__ import annotations

import re
from collections.abc import Iterable

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment

_COMMANDS = re.compile(r"[\x00-\x09\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")


class CleanConsole(Console):
    """rich's console; control characters in a text become visible."""

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """See rich. Control segments of rich itself (a progress bar's) stay."""
        for segment in super().render(renderable, options):
            if segment.control or not _COMMANDS.search(segment.text):
                yield segment
            else:
                yield Segment(clean(segment.text), segment.style)


def clean(text: str) -> str:
    """The text with every control character but the line break made visible, as \\x1b."""
    return _COMMANDS.sub(lambda found: found.group().encode("unicode_escape").decode(), text)
