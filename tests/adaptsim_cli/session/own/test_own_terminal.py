"""A person with a ruler at a real terminal: a whole session, from the first question to the adaptation."""

from __future__ import annotations

import os
import pty
import re
import select
import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from adaptsim_cli import api

PATIENCE_S = 300.0
LISTENS_S = 0.5  # what is typed before a question ends is thrown away

SPEED_M_S = re.compile(r"push speed (0\.\d+) m/s")


@dataclass
class Ruler:
    """A person who pushes a bottle on a table with friction 0.12, and measures where it comes to rest."""

    session: str = ""
    wrong: list[str] = field(default_factory=lambda: ["0,71", "far away"])  # typed first, at the first number
    asked: list[str] = field(default_factory=list)

    def answer(self, question: str) -> str:
        """What is typed at a question, by its last line."""
        self.asked.append(question)
        if "Where did it come to rest? x [m]" in question:
            return self.wrong.pop(0) if self.wrong else f"{0.56 + self._way_m():.3f}"
        if "Where did it come to rest? y [m]" in question:
            return "0.01"
        if "Where did it come to rest? z [m]" in question:
            return "0.035"
        if "How did it end?" in question:
            return "upright"
        return "y" if "Type y" in question else ""

    def _way_m(self) -> float:
        return float(SPEED_M_S.findall(self.session)[-1]) ** 2 / (2 * 9.81 * 0.12)


def played(person: Ruler, *line: str) -> tuple[int, str]:
    """Run the command at a terminal with this person -> its exit status, and all that stood there."""
    master, slave = pty.openpty()
    program = [sys.executable, "-m", "adaptsim_cli", *line]
    at_terminal = {**os.environ, "TERM": "xterm", "COLUMNS": "120", "LINES": "40"}
    process = subprocess.Popen(program, stdin=slave, stdout=slave, stderr=slave, env=at_terminal, close_fds=True)
    os.close(slave)
    shown, answered, until_s = "", 0, time.monotonic() + PATIENCE_S
    while process.poll() is None and time.monotonic() < until_s:
        if select.select([master], [], [], LISTENS_S)[0]:
            try:
                shown += os.read(master, 65536).decode(errors="replace")
            except OSError:
                break
            continue
        plain = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", shown).rstrip(" ")
        if len(shown) > answered and plain.endswith(":"):
            person.session, answered = " ".join(plain.split()), len(shown)
            os.write(master, (person.answer(plain.splitlines()[-1]) + "\n").encode())
    try:
        code = process.wait(max(until_s - time.monotonic(), 5.0))
    finally:
        process.kill()  # does nothing to a command that has ended
    os.close(master)
    return code, re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", shown)


@pytest.mark.slow
def test_a_person_answers_a_whole_session_and_it_adapts(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setenv("ADAPTSIM_HOME", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    person = Ruler()
    line = ("run-iteration", "--task", "pushing", "--hw", "own", "--answer-with", "person", "--session", "ruler")
    code, shown = played(person, *line)
    told = " ".join(shown.split())
    assert code == 0, shown[-2000:]
    assert "0,71 is not a number; write it with a point" in told
    assert "far away is not a number" in told
    assert "Is this your table? At the end of the first trial: x 0." in told
    assert told.count("adaptsim checks none of its motion") >= 4
    session = api.open_session("ruler")
    assert len(session.trials) == 4
    assert {trial.outcome for trial in session.trials} == {"upright"}
    assert all(trial.track.state[-1][0] > 0.56 for trial in session.trials)
    before = {trial.particle: dict(trial.parameters) for trial in session.trials}
    assert all(dict(after) != before[n] for n, after in enumerate(session.iterations[0].next_parameters, start=1))
    page = (tmp_path / "data/sessions/ruler/first-trial.html").read_text()
    assert page.count('class="later"') == 64
    assert "Is this your table?" in page

    left = Ruler()
    left.answer = lambda question: "q" if "Where did it" in question else Ruler.answer(left, question)  # type: ignore[method-assign]
    code, shown = played(left, "run-iteration", "--session", "ruler", "--answer-with", "person")
    assert code == 7, "the person left"
    assert "the same command asks for this trial again" in " ".join(shown.split())
