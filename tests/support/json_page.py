"""What the page of JSON output says of each command."""

from __future__ import annotations

import re
from pathlib import Path

PAGE = Path(__file__).parents[2] / "docs/reference/json.md"
_ROW = re.compile(r"^\| `adaptsim ([^`]*)--json`[^|]* \| (.*) \|$", re.MULTILINE)


def keys_of(command: str) -> set[str]:
    """The keys that the page names for `adaptsim COMMAND --json`. Raises KeyError for a command that it leaves out."""
    rows = {line.strip(): keys for line, keys in _ROW.findall(PAGE.read_text(encoding="utf-8"))}
    return set(re.findall(r"`(\w+)`", rows[command]))
