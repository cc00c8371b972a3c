"""Run the notebooks of the guide as they ship, and store them with their outputs: python docs/notebooks.py

Each runs in a home of its own, cell by cell, in this process: no package of Jupyter is needed. A test runs them again
and compares the words.
"""

from __future__ import annotations

import ast
import contextlib
import io
import json
import os
import sys
import tempfile
from base64 import b64encode
from collections.abc import Iterator
from pathlib import Path
from typing import Any

GUIDE = Path(__file__).parent / "guide"
NOTEBOOKS = (GUIDE / "session-from-python.ipynb", GUIDE / "ask-and-tell.ipynb")


def executed(notebook: dict[str, Any]) -> dict[str, Any]:
    """The notebook with the outputs of all its cells, run in order. Raises the error of a cell."""
    names: dict[str, Any] = {"__name__": "notebook"}
    cells, count = list[dict[str, Any]](), 0
    for cell in notebook["cells"]:
        if cell["cell_type"] != "code":
            cells.append(cell)
            continue
        count += 1
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            value = run_cell("".join(cell["source"]), names)
        cells.append({**cell, "execution_count": count, "outputs": list(_outputs(count, printed.getvalue(), value))})
    return {**notebook, "cells": cells}


def run_cell(source: str, names: dict[str, Any]) -> Any:
    """Execute a cell; returns the value of its last line where that is an expression, as a notebook shows it."""
    tree = ast.parse(source)
    last = tree.body[-1]
    if not isinstance(last, ast.Expr):
        exec(compile(tree, "notebook", "exec"), names)
        return None
    tree.body.pop()
    exec(compile(tree, "notebook", "exec"), names)
    return eval(compile(ast.Expression(last.value), "notebook", "eval"), names)  # noqa: S307 - of this repository


def _outputs(count: int, printed: str, value: Any) -> Iterator[dict[str, Any]]:
    if printed:
        yield {"name": "stdout", "output_type": "stream", "text": printed.splitlines(keepends=True)}
    if value is None:
        return
    data: dict[str, Any] = {"text/plain": repr(value).splitlines(keepends=True)}
    if (as_html := getattr(value, "_repr_html_", None)) is not None:
        data["text/html"] = as_html().splitlines(keepends=True)
    if (as_png := getattr(value, "_repr_png_", None)) is not None:
        data["image/png"] = b64encode(as_png()).decode()
    yield {"data": data, "execution_count": count, "metadata": {}, "output_type": "execute_result"}


def main() -> int:
    for path in NOTEBOOKS:
        with tempfile.TemporaryDirectory() as home:
            os.environ["ADAPTSIM_HOME"] = home
            notebook = executed(json.loads(path.read_text(encoding="utf-8")))
        path.write_text(json.dumps(notebook, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
        print(path.relative_to(GUIDE.parents[1]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
