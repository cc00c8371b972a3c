"""One toy iteration of two trials, for a disk that fails."""

from __future__ import annotations

import json
import os
from pathlib import Path

from failing_disk import main
from rich.console import Console
from toy_rig import ToyLab, opener

from adaptsim_cli import config
from adaptsim_cli.report import page
from adaptsim_cli.screen import console
from adaptsim_cli.session import running
from adaptsim_cli.session.keeping import verify
from adaptsim_cli.session.store import TRIAL, SessionStore

NAME = "toy-wd"
VOLATILE = {"timing_s", "proposal_s", "started", "created", "at", "checksums", "summary_sha256", "sealed"}


class ToySession:
    def run(self, home: Path) -> None:
        with Path(os.devnull).open("w") as nothing:
            vars(console)["CleanConsole"] = lambda **_: Console(file=nothing)
            request = running.SessionRequest(None, frozenset({"task"}), iterations=1, yes=True)
            settings = config.load({"task": "toy", "particles": 1}, {"ADAPTSIM_HOME": str(home)}, home)
            running.run_session(settings, request, opener(ToyLab(7)), page.write)

    def completed(self, home: Path) -> dict[str, bytes]:
        """Every file of every trial that has its record."""
        return {
            str(path.relative_to(home)): path.read_bytes()
            for record in self._session(home).glob(f"iteration-*/*/{TRIAL}")
            for path in record.parent.iterdir()
            if not path.name.startswith(".")
        }

    def is_over(self, home: Path) -> bool:
        """After it has been shown, the same command would begin the next iteration."""
        root = self._session(home)
        return root.is_dir() and bool(SessionStore.open(root.parent, root.name).existing().shown)

    def digest(self, home: Path) -> dict[str, object]:
        return digest_of(home / "data")

    def damage(self, home: Path) -> tuple[str, ...]:
        return verify(self._session(home).parent, NAME).damage

    def _session(self, home: Path) -> Path:
        return home / "data" / "sessions" / NAME


def digest_of(folder: Path) -> dict[str, object]:
    """Every file below `folder` by its path, without times of day and durations."""
    return {
        str(path.relative_to(folder)): _content(path)
        for path in sorted(folder.rglob("*"))
        if path.is_file() and not any(part.startswith(".") for part in path.relative_to(folder).parts)
    }


def _content(path: Path) -> object:
    if path.suffix == ".json":
        return _steady(json.loads(path.read_text()))
    return path.exists() if path.suffix in (".html", ".toml", ".jsonl") else path.stat().st_size


def _steady(value: object) -> object:
    if isinstance(value, dict):
        return {key: _steady(v) for key, v in value.items() if key not in VOLATILE}
    return [_steady(v) for v in value] if isinstance(value, list) else value


if __name__ == "__main__":
    main(ToySession())
