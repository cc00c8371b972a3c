"""The Python of the documents: the notebook from its first cell to its last, and the examples of the Python page."""

from __future__ import annotations

import json
import re
import shlex
import sys
import types
from typing import Any

import notebooks
import pytest
from documents import FENCE, ROOT, code_in, install

from adaptsim_cli.commands import app
from hw import plugins
from sim.adaptation import methods
from sim.tasks import get_task


@pytest.fixture(params=notebooks.NOTEBOOKS, ids=lambda page: page.stem)
def stored(request) -> dict[str, Any]:
    return json.loads(request.param.read_text(encoding="utf-8"))


def shown(notebook: dict[str, Any]) -> list[tuple[str, str, str]]:
    """(cell, kind, words) of each output; a number is a digit, because computers differ in the last ones."""
    kept = []
    for cell in notebook["cells"]:
        for output in cell.get("outputs", []):
            for kind, content in output.get("data", {"stdout": output.get("text", [])}).items():
                text = "" if kind == "image/png" else re.sub(r'"data:[^"]*"', "", "".join(content))
                kept.append((cell["id"], kind, re.sub(r"-?[0-9][0-9.e+-]*", "0", text)))
    return kept


def test_a_notebook_is_stored_with_its_outputs_and_no_path_of_a_computer(stored):
    assert stored["nbformat"] == 4
    ids = [cell["id"] for cell in stored["cells"]]
    assert len(set(ids)) == len(ids)
    code = [cell for cell in stored["cells"] if cell["cell_type"] == "code"]
    assert [cell["execution_count"] for cell in code] == list(range(1, len(code) + 1))
    kinds = [kind for _, kind, _ in shown(stored)]
    assert "image/png" in kinds and "text/html" in kinds
    for cell in code:
        assert cell["outputs"] or "def " in "".join(cell["source"]), cell["id"]
        assert not re.search(r"/(root|home|tmp|work)/", json.dumps(cell["outputs"])), cell["id"]


@pytest.mark.long
def test_a_notebook_runs_as_it_ships_and_shows_what_it_is_stored_with(stored, tmp_path, monkeypatch, capfd):
    monkeypatch.setenv("ADAPTSIM_HOME", str(tmp_path))
    again = notebooks.executed(stored)
    assert shown(again) == shown(stored), "make them again: python docs/notebooks.py"
    assert capfd.readouterr() == ("", "")


@pytest.mark.long
def test_the_examples_of_the_python_page_run(tmp_path, monkeypatch):
    monkeypatch.setenv("ADAPTSIM_HOME", str(tmp_path))
    monkeypatch.chdir(tmp_path)  # plots are saved here
    names: dict[str, object] = {}
    for code in code_in("docs/reference/python.md", "python"):
        exec(code, names)
    assert "track" in names
    assert (tmp_path / "data/sessions/study/report.html").is_file()


@pytest.mark.long
def test_the_method_of_the_tutorial_runs_is_compared_and_is_found_in_a_package(tmp_path, monkeypatch):
    monkeypatch.setenv("ADAPTSIM_HOME", str(tmp_path / "home"))
    written = code_in("docs/guide/add-a-method.md", "python")
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


@pytest.mark.long
def test_the_readme_shows_what_its_last_command_and_its_python_print(tmp_path, monkeypatch, capfd):
    monkeypatch.setenv("ADAPTSIM_HOME", str(tmp_path))
    monkeypatch.setenv("COLUMNS", "80")
    blocks = {language: code for _, language, code in FENCE.findall((ROOT / "README.md").read_text(encoding="utf-8"))}
    *_, last = blocks["sh"].splitlines()
    command = shlex.split(last, comments=True)
    assert app.run(command[1:]) == 0
    assert " ".join(blocks["text"].split()) in " ".join(capfd.readouterr().out.split())
    exec(blocks["python"], {})
    rewards = [float(line) for line in capfd.readouterr().out.split()]
    assert rewards == pytest.approx([1.0, 0.3], abs=0.005)
