"""The pages that `make docs` writes are those that the code says now."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def generate() -> ModuleType:
    spec = importlib.util.spec_from_file_location("generate", ROOT / "docs/generate.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_committed_pages_are_current(generate: ModuleType) -> None:
    assert not (old := generate.stale()), f"run `make docs` and commit: {', '.join(old)}"


def test_every_documented_error_has_an_exit_code_and_advice(generate: ModuleType) -> None:
    page = generate.messages()
    for kind in generate._error_classes():
        assert kind.__name__ in page
    assert "the disk is full" in page
    assert "must be positive" in page


def test_every_number_of_every_task_is_explained(generate: ModuleType) -> None:
    page = generate.parameters()
    for name in generate.TASKS:
        task = generate.get_task(name)
        for space in (task.parameters, task.context, task.action, task.nuisance):
            for dimension in space.dimensions:
                assert f"| `{dimension.name}` |" in page


def test_a_field_without_a_meaning_is_an_error(
    generate: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "nameless.py").write_text("class Model:\n    quux: int = 3\n    good: int  # says what it is\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(SystemExit, match="quux says nowhere what it means"):
        list(generate.fields("nameless", "Model"))
    monkeypatch.setitem(generate.SAID, "quux", "a test")
    assert list(generate.fields("nameless", "Model")) == [
        ("quux", "int", "`3`", "a test"),
        ("good", "int", "–", "says what it is"),
    ]
