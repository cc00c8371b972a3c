"""`adaptsim setup`, practised at a terminal from nothing to the first scoop, and killed on the way."""

from __future__ import annotations

import fcntl
import os
import pty
import re
import select
import signal
import struct
import termios
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import pytest
from lab_session import ADAPTSIM, environment

from adaptsim_cli.bench.rig_file.reading import read

COMMAND = [*ADAPTSIM, "setup", "--world", "cucumber"]
PATIENCE_S = 600.0
QUIET_S = 0.5
"""After so long without output a line that ends with a colon is a question, and typing is heard."""
TYPED = {"How high is the table top?": "0.000", "Name a box": "lamp", "upper corner": "0.7 -0.7 0.5"}
"""The answers that are not Enter, each typed once, by what the question has in it."""


@dataclass
class Terminal:
    """80 × 24, with a person who answers."""

    folder: Path
    said: str = ""

    def run(self, answers: Mapping[str, str], kill_at: str = "") -> int:
        """The command to its end, or until it says `kill_at`; returns the exit code, -9 if it was killed."""
        left, self.said = dict(answers), ""
        process, screen = pty.fork()
        if process == 0:
            os.chdir(self.folder)
            os.execve(COMMAND[0], COMMAND, environment(self.folder / "home", TERM="xterm-256color"))
        fcntl.ioctl(screen, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
        answered = 0
        while True:
            ready, _, _ = select.select([screen], [], [], QUIET_S)
            if ready:
                try:
                    self.said += plain(os.read(screen, 65536).decode(errors="replace"))
                except OSError:  # the program has ended
                    break
                if kill_at and kill_at in self.said:
                    os.kill(process, signal.SIGKILL)
                assert "Not ready yet" not in self.said, self.said
            elif self.said[answered:].rstrip().endswith(":"):
                question, answered = self.said[answered:], len(self.said)
                key = next((words for words in left if words in question.rpartition("\n\n")[2]), "")
                os.write(screen, (left.pop(key) if key else word(question)).encode() + b"\n")
        os.close(screen)
        return os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])


def word(question: str) -> str:
    """What lets something move: the word that the question asks for, else Enter."""
    wanted = re.search(r"Type (\w+) to (?:start|let|confirm)", " ".join(question.split()))
    return wanted[1] if wanted else ""


def plain(text: str) -> str:
    return re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", text).replace("\r", "")


@pytest.mark.slow
def test_from_nothing_to_the_first_scoop_with_a_kill_in_the_middle(tmp_path):
    there, began_s = Terminal(tmp_path), time.monotonic()
    assert there.run(TYPED, kill_at="9 of 25  ") == -signal.SIGKILL, there.said
    rig = read(tmp_path / "home/practice.toml")
    assert [box.high_m for box in rig.keep_out] == [(0.7, -0.7, 0.5)]
    assert rig.tool("board").payload is not None
    assert there.run({}) == 0, there.said
    assert "Name a box" not in there.said, "what was answered is not asked again"
    assert "Continuing with" in there.said and "Accepted" in there.said
    assert "to its end, as a rehearsal" not in there.said
    assert "Next: adaptsim run-iteration --task scooping --world cucumber" in there.said
    sessions = tmp_path / "home/data/sessions"
    (stored,) = {path.parents[2] for path in sessions.glob("rollout-*/iteration-*/trial-*/trial.json")}
    assert stored.name in there.said.replace("\n", "")
    assert there.run({}) == 0
    assert "of 25" not in there.said, "everything is done"
    assert time.monotonic() - began_s < 3 * PATIENCE_S
