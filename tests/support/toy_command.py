"""Commands of the program in this process, where a session has the toy rig."""

from __future__ import annotations

import io
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from pathlib import Path

import pytest
from toy_rig import ToyLab, toy_parts

from adaptsim_cli import app
from adaptsim_cli.config import Config
from adaptsim_cli.session.target import Parts
from adaptsim_cli.wiring import session as wiring

RUN = ("run-iteration", "--task", "toy", "--session", "s", "--yes", "--json")


def call(home: Path, command: Sequence[str], lab: ToyLab | None = None) -> tuple[int, str]:
    """Its exit code, and what it said on stderr, on one line. Settings are those of the folder that `home` lies in."""
    bench = lab or ToyLab(7)

    @contextmanager
    def opened(config: Config, learnt: Path, **_: object) -> Iterator[Parts]:
        with bench:
            yield toy_parts(bench)

    said = io.StringIO()
    with pytest.MonkeyPatch.context() as patch:
        for name in [name for name in os.environ if name.startswith("ADAPTSIM_")]:
            patch.delenv(name)
        patch.setenv("ADAPTSIM_HOME", str(home))
        patch.chdir(home.parent)
        patch.setattr(wiring, "open_parts", opened)
        with redirect_stdout(io.StringIO()), redirect_stderr(said):
            code = app.run(command)
    return code, " ".join(said.getvalue().split())
