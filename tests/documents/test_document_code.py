"""The Python of the documents runs."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"
PYTHON = re.compile(r"^```python\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def test_the_examples_of_the_python_page_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ADAPTSIM_HOME", str(tmp_path))
    names: dict[str, object] = {}
    for code in PYTHON.findall((DOCS / "reference/python.md").read_text(encoding="utf-8")):
        exec(code, names)
    assert "track" in names
    assert (tmp_path / "data/sessions/study/report.html").is_file()
