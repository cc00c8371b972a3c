"""One toy iteration of two trials, for a disk that fails."""

from __future__ import annotations

import os
from pathlib import Path

from failing_disk import main
from lab_session import digest_of
from rich.console import Console
from toy_rig import ToyLab, opener

from adaptsim_cli import config
from adaptsim_cli.screen import console
from adaptsim_cli.session import running
from adaptsim_cli.session.keeping import verify
from adaptsim_cli.session.store import TRIAL, SessionStore
from adaptsim_cli.show import page

NAME = "toy-wd"


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


if __name__ == "__main__":
    main(ToySession())
