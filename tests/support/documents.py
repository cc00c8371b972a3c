"""The pages that a reader finds, as Markdown, and the commands in them."""

from __future__ import annotations

import json
import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGES = (
    *sorted(ROOT.glob("*.md")),
    *sorted((ROOT / "docs").rglob("*.md")),
    *sorted((ROOT / "docs").rglob("*.ipynb")),
)
FENCE = re.compile(r"^( *)```(.*?)\n(.*?)^\1```$", re.MULTILINE | re.DOTALL)
_PREFIX = re.compile(r"^(?:\$ )?(?:[A-Z][A-Z0-9_]*=\S* )*")


def shown(page: Path) -> str:
    """The path of a page within the repository."""
    return str(page.relative_to(ROOT))


def read(page: Path) -> str:
    """A page as Markdown. The code cells of a notebook become fences."""
    text = page.read_text(encoding="utf-8")
    if page.suffix != ".ipynb":
        return text
    cells = [(cell["cell_type"], "".join(cell["source"])) for cell in json.loads(text)["cells"]]
    return "\n\n".join(f"```python\n{source}\n```" if kind == "code" else source for kind, source in cells) + "\n"


def commands(text: str, program: str = "adaptsim") -> list[str]:
    """Every call of `program` in a page: lines of its code blocks, fenced or indented, and spans within its prose."""
    blocks = [line for match in FENCE.finditer(text) for line in match[3].splitlines()]
    prose = FENCE.sub("", text)
    blocks += [line for line in prose.splitlines() if line.startswith("    ")]
    spans = [" ".join(span.split()) for span in re.findall(r"`([^`]+)`", prose)]
    lines = [_PREFIX.sub("", line.strip()) for line in (*blocks, *spans)]
    return [line for line in lines if line == program or line.startswith(f"{program} ")]
