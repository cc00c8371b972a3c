"""`--speak`: what is said aloud, by a stand-in for espeak-ng that writes down what it was told."""

from __future__ import annotations

import io
import time
from pathlib import Path

from real_lab import quiet

from adaptsim_cli.screen.keys import enter, stop
from adaptsim_cli.screen.speaking import Speaker


def spoken(file: Path, lines: int) -> list[str]:
    until_s = time.monotonic() + 30.0
    while not file.exists() or len(file.read_text().splitlines()) < lines:
        assert time.monotonic() < until_s, "it was not said"
        time.sleep(0.01)
    return file.read_text().splitlines()


def test_warnings_and_questions_are_spoken_without_their_keys(tmp_path, monkeypatch):
    program = tmp_path / "espeak-ng"
    program.write_text(f'#!/bin/sh\necho "$@" >> {tmp_path}/said\n')
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:/bin:/usr/bin")
    screen = quiet()
    screen.tell(Speaker())
    screen.note("  Hold the pedal")
    assert spoken(tmp_path / "said", 1) == ["-- Hold the pedal"]
    monkeypatch.setattr("sys.stdin", io.StringIO("\n"))
    screen.choose("Is the work area clear?", enter("to start", "It moves."), stop("It ends."))
    assert spoken(tmp_path / "said", 2)[1:] == ["-- Is the work area clear?"]


def test_without_a_program_that_speaks_the_command_says_which_to_install(tmp_path, monkeypatch, refused, kim):
    monkeypatch.setenv("ADAPTSIM_SPEAK", "")  # taken back after the test
    monkeypatch.setenv("PATH", str(tmp_path))
    assert "sudo apt-get install -y espeak-ng" in refused(2, "setup", "--speak", "--yes")
