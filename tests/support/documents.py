"""The pages that a reader finds, as Markdown, the commands in them, and the contracts that their code keeps."""

from __future__ import annotations

import importlib.util
import inspect
import json
import re
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

from sim import tasks

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


def module(path: Path) -> ModuleType:
    """The module of a file, made anew."""
    spec = importlib.util.spec_from_file_location(f"loaded_{path.parent.name}_{path.stem}", path)
    assert spec is not None and spec.loader is not None
    made = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = made
    spec.loader.exec_module(made)
    return made


def require_kept(contract: ModuleType, **given: Any) -> None:
    """Run the tests of a contract that take these arguments and no others."""
    tests: list[Callable[..., None]] = [
        test
        for name, test in vars(contract).items()
        if name.startswith("test_") and list(inspect.signature(test).parameters) == list(given)
    ]
    assert len(tests) >= 4
    for test in tests:
        test(**given)


def install(folder: Path, package: str, offered: Mapping[str, str]) -> None:
    """Metadata in `folder` as of an installed package that offers these tasks."""
    info = folder / f"{package}-1.0.dist-info"
    info.mkdir()
    lines = [f"[{tasks.OFFERED}]", *(f"{name} = {value}" for name, value in offered.items())]
    (info / "entry_points.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.0\n", encoding="utf-8")
