"""The sentence about a missing extra, for each way of installing the program, and sessions without PyTorch."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from importlib import metadata

import pytest

from hw import extras


class Distribution:
    def __init__(self, origin: dict[str, object] | None) -> None:
        self.origin = origin

    def read_text(self, name: str) -> str | None:
        return json.dumps(self.origin) if self.origin is not None and name == "direct_url.json" else None


@pytest.mark.parametrize(
    ("origin", "line"),
    [
        (None, "pip install 'adaptsim[bo]'"),
        ({"url": "https://example.org/a.whl", "archive_info": {}}, "pip install 'adaptsim[bo]'"),
        ({"url": "file:///home/kim/my%20lab", "dir_info": {}}, "pip install '/home/kim/my lab[bo]'"),
        ({"url": "file:///home/kim/lab", "dir_info": {"editable": True}}, "pip install -e '/home/kim/lab[bo]'"),
    ],
)
def test_an_extra_is_installed_from_where_the_program_came_from(monkeypatch, origin, line):
    monkeypatch.setattr(metadata, "distribution", lambda name: Distribution(origin))
    extras._origin.cache_clear()
    try:
        assert extras.install_line("bo") == line
        assert extras.missing("bo", "botorch", "bo").endswith(f"is not installed: {line}")
    finally:
        extras._origin.cache_clear()


def test_versions_are_those_of_installed_packages():
    assert extras.installed("numpy", "no-such-package") == {"numpy": metadata.version("numpy")}


SESSION = """
import sys
class Without:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] == "torch":
            raise ModuleNotFoundError("No module named 'torch'", name="torch")
if sys.argv.pop(1) == "without":
    sys.meta_path.insert(0, Without())
from adaptsim_cli.commands.app import main
main()
"""
LINE = ("run-iteration", "--task", "pendulum", "--world", "ood-1", "--yes", "--json")


def output(tmp_path, way: str, *line: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "ADAPTSIM_HOME": str(tmp_path / way)}
    command = [sys.executable, "-c", SESSION, way, *line]
    return subprocess.run(command, capture_output=True, text=True, env=environment, check=False)


def test_a_session_has_the_same_numbers_without_pytorch(tmp_path):
    results = [json.loads(output(tmp_path, way, *LINE).stdout) for way in ("with", "without")]
    for result in results:
        del result["timing_s"]
    assert results[0] == results[1]


def test_pretraining_without_pytorch_is_one_sentence(tmp_path):
    refused = output(tmp_path, "without", "pretrain", "--task", "pushing", "--budget", "small")
    assert refused.returncode != 0
    assert "pretraining needs the package torch, which is not installed: pip install" in refused.stderr
    assert "Traceback" not in refused.stderr
