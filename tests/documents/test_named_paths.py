"""Files that documents and code name exist."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from documents import PAGES, ROOT, read, shown

SPAN = re.compile(
    r"`((?:adaptsim_cli|benchmarks|calib|docs|hw|perception|sim|tests)/[\w./-]+\.(?:py|md|toml|svg|png|ino))`"
)
MADE_BY_A_READER = {"sim/tasks/curling/__init__.py"}
IN_CODE = re.compile(r"docs/[\w/-]+\.md")
DECISION = re.compile(r"docs/decisions/(\d{4})")


@pytest.mark.parametrize("document", PAGES, ids=shown)
def test_every_path_in_a_document_exists(document: Path) -> None:
    named = set(SPAN.findall(read(document))) - MADE_BY_A_READER
    assert not (gone := sorted(name for name in named if not (ROOT / name).exists())), gone


def test_every_document_that_the_code_names_exists() -> None:
    gone = []
    for folder in ("adaptsim_cli", "benchmarks", "calib", "hw", "perception", "sim", "tests"):
        for path in (ROOT / folder).rglob("*.py"):
            text = path.read_text(encoding="utf-8")
            gone += [f"{path.name}: {name}" for name in IN_CODE.findall(text) if not (ROOT / name).is_file()]
            gone += [
                f"{path.name}: {n}" for n in DECISION.findall(text) if not [*ROOT.glob(f"docs/decisions/{n}-*.md")]
            ]
    assert not gone, gone
