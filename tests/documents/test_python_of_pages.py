"""The Python of the documents: the notebook from its first cell to its last, and the examples of the Python page."""

from __future__ import annotations

import json
import re
import sys
import types
from typing import Any

import pytest
from documents import FENCE, ROOT, cells_of, install, run_cell

from hw import plugins
from sim.adaptation import methods
from sim.tasks import get_task

NOTEBOOK, ASKED = ROOT / "docs/guide/session-from-python.ipynb", ROOT / "docs/guide/ask-and-tell.ipynb"


@pytest.mark.long
def test_every_cell_runs_in_order(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("ADAPTSIM_HOME", str(tmp_path))
    names: dict[str, Any] = {"__name__": "notebook"}
    shown = [run_cell(source, names) for source in cells_of(NOTEBOOK).values()]
    said = capsys.readouterr().out
    assert shown[0] == "balance a double pendulum with a linear feedback"
    assert re.search(r"iteration 2: mean reward 0\.\d\d\. (go_on|enough), reward 0\.\d\d", said)
    assert said.count(" settled ") == 4
    assert "the weight lies on 2048 parameter sets before" in said
    expected = float(said.split("expected reward ")[1].split()[0])
    assert expected > 0.8, "under the tempered posterior"
    assert shown[-1] == tmp_path / "data/sessions/notebook/report.html"


@pytest.mark.parametrize("page", [NOTEBOOK, ASKED], ids=lambda page: page.stem)
def test_it_is_a_notebook_without_outputs(page):
    notebook = json.loads(page.read_text(encoding="utf-8"))
    assert notebook["nbformat"] == 4
    ids = [cell["id"] for cell in notebook["cells"]]
    assert len(set(ids)) == len(ids)
    assert not any(cell.get("outputs") for cell in notebook["cells"])


@pytest.mark.long
def test_the_examples_of_the_python_page_run(tmp_path, monkeypatch):
    monkeypatch.setenv("ADAPTSIM_HOME", str(tmp_path))
    names: dict[str, object] = {}
    for _, language, code in FENCE.findall((ROOT / "docs/reference/python.md").read_text(encoding="utf-8")):
        if language == "python":
            exec(code, names)
    assert "track" in names
    assert (tmp_path / "data/sessions/study/report.html").is_file()


@pytest.mark.long
def test_the_method_of_the_tutorial_runs_is_compared_and_is_found_in_a_package(tmp_path, monkeypatch):
    monkeypatch.setenv("ADAPTSIM_HOME", str(tmp_path / "home"))
    text = (ROOT / "docs/guide/add-a-method.md").read_text(encoding="utf-8")
    written = [code for _, language, code in FENCE.findall(text) if language == "python"]
    monkeypatch.setattr(methods, "_registered", {})
    module = types.ModuleType("tutorial")
    monkeypatch.setitem(sys.modules, "tutorial", module)
    for code in written:
        exec(code, module.__dict__)
    names = module.__dict__
    assert [row["trials"] for row in names["curve"]] == [2, 4, 6]
    assert names["final"].keys() == {"udr", "narrowing", "random"}

    (tmp_path / "narrowing.py").write_text(written[0], encoding="utf-8")
    install(tmp_path, "narrowing", {"narrowing": "narrowing:create", "udr": "narrowing:create"}, methods.REGISTRY.group)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(methods, "_registered", {})
    plugins.offers.cache_clear()
    try:
        found = methods.make_method("narrowing", get_task("pendulum"), None)
        assert type(found).__name__ == "Narrowing"
        assert type(methods.make_method("udr", get_task("pendulum"), None)).__name__ == "Udr"
        assert methods.method_names().count("udr") == 1
        with pytest.raises(ValueError, match="'narrowing' exists already"):
            methods.register("narrowing", names["create"])
    finally:
        plugins.offers.cache_clear()
        sys.modules.pop("narrowing", None)
