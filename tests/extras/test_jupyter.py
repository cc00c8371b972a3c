"""A session in a real kernel of Jupyter: one progress bar, one rich result, and nothing else on the page."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

pytestmark = pytest.mark.extra

CELLS = (
    'import adaptsim\nsession = adaptsim.begin("pendulum", world="ood-1", name="study")',
    "session.run(1)",
    "session.learning_curve().plot()",
    "from perception.raycasting import load_open3d\nload_open3d() and None",
)


def test_a_run_shows_one_bar_and_its_result(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import nbformat  # noqa: PLC0415 - collected without the extra too
    from nbclient import NotebookClient  # noqa: PLC0415

    monkeypatch.setenv("ADAPTSIM_HOME", str(tmp_path))
    book: Any = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(source) for source in CELLS])
    NotebookClient(book, timeout=280, kernel_name="python3").execute()
    outputs = [cell["outputs"] for cell in book["cells"]]
    assert outputs[0] == []
    bar, result = outputs[1]
    assert bar["output_type"] == "display_data" and '<progress value="2" max="2">' in bar["data"]["text/html"]
    assert result["output_type"] == "execute_result" and "in the first iteration" in result["data"]["text/html"]
    (plot,) = outputs[2]
    assert set(plot["data"]) == {"text/plain", "image/png"}
    assert outputs[3] == [], "Open3D prints nothing into a notebook"
