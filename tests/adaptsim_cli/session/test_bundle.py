from __future__ import annotations

import json
import zipfile
from pathlib import Path

import pytest
from toy_session import NAME, run

from adaptsim_cli import app


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    home = tmp_path_factory.mktemp("bundle")
    run(home)
    return home


@pytest.mark.parametrize("pictures", [False, True])
def test_a_bundle_holds_records_and_pictures_only_if_asked(
    home: Path, tmp_path: Path, pictures: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("ADAPTSIM_HOME", str(home))
    monkeypatch.setattr(Path, "home", lambda: home)
    out = tmp_path / "b.zip"
    assert app.run(["bundle", NAME, "--out", str(out), *(["--with-pictures"] if pictures else [])]) == 0
    with zipfile.ZipFile(out) as archive:
        names = archive.namelist()
        about = json.loads(archive.read("about.json"))
        texts = [archive.read(name).decode() for name in names if name.endswith((".json", ".toml"))]
    assert f"{NAME}/iteration-01/trial-001-attempt-1/trial.json" in names
    assert any(name.endswith(".mcap") for name in names) == pictures
    assert any(name.endswith(".jpg") for name in names) == pictures
    assert about["packages"]["torch"].startswith("2.")
    assert about["settings"]["particles"] == {"value": 2, "from": "default"}
    assert not any(str(home) in text for text in texts)
    assert ("Left out" in capsys.readouterr().out) != pictures


def test_a_session_that_is_not_there_is_named(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ADAPTSIM_HOME", str(home))
    assert app.run(["bundle", "nothing"]) == 8
