"""Two commands at once about one session, each in a process of its own, again and again.

    python racing_commands.py FOLDER RACES

Every race begins with a copy of the same data folder. Both processes wait at a gate, then for a moment that is drawn.
Afterwards the session is carried on to the end of its first iteration. Whatever happened in between, that end has to be
one to which the commands come one after the other, in either order, or one of them alone.

Prints one line of JSON a race: exit codes, what was said, to which end it came (null: to none of these), what `sessions
verify` finds damaged, and what was left behind.

A program of its own, so that forking never meets the threads of a test run; run it with one thread (`ONE_THREAD` of
its test).
"""

from __future__ import annotations

import json
import os
import shutil
import sys
import time
import traceback
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from lab_session import digest_of
from toy_rig import ToyLab
from toy_session import RUN, call

from adaptsim_cli.session.keeping import verify
from adaptsim_cli.session.store import SessionStore
from sim.storage.files import TEMPORARY

NOTE = ("sessions", "mark", "s", "--note", "the lamp was moved")
SECOND_NOTE = ("sessions", "mark", "s", "--note", "the lamp was turned")
REDO = ("sessions", "redo", "s", "1", "--reason", "it was pushed by hand")
DELETE = ("sessions", "delete", "s", "--yes")
VERIFY = ("sessions", "verify", "s")
PRUNE = ("sessions", "prune", "s", "--yes")
DEFECT = 70
"""The exit code where a command ended with a traceback."""


@dataclass(frozen=True)
class Race:
    """Two commands, and what there is of the session before."""

    before: str  # nothing, half: stopped in the middle of its second trial; done: its first iteration
    commands: tuple[tuple[str, ...], tuple[str, ...]]


RACES = (
    Race("nothing", (RUN, RUN)),
    Race("half", (RUN, RUN)),
    Race("half", (RUN, NOTE)),
    Race("half", (RUN, DELETE)),
    Race("half", (RUN, VERIFY)),
    Race("done", (NOTE, SECOND_NOTE)),
    Race("done", (REDO, REDO)),
    Race("done", (NOTE, DELETE)),
    Race("done", (PRUNE, DELETE)),
)


class Homes:
    """Where the commands run: folders below `root`, each with the data of one race."""

    def __init__(self, root: Path) -> None:
        self._root = root
        (root / "adaptsim.toml").write_text("particles = 1\n")
        self._templates = {"nothing": root / "nothing"}
        self.took_s: dict[tuple[str, ...], float] = {}
        call(root / "warm", RUN)  # in this process, so that every child has loaded what it needs
        for name in ("half", "done"):
            self._templates[name] = root / name
            code, said = done(root / name, RUN, interrupted=name == "half")
            assert code == (130 if name == "half" else 0), said

    def copy(self, before: str, name: str) -> Path:
        home = self._root / name
        if self._templates[before].is_dir():
            shutil.copytree(self._templates[before], home)
        return home

    def alone(self, race: Race) -> dict[str, str]:
        """The ends to which the commands come without a race, each with the order that led there."""
        first, second = race.commands
        ends = {}
        for order in ((first, second), (second, first), (first,), (second,)):
            home = self.copy(race.before, "alone")
            for command in order:
                began_s = time.monotonic()
                done(home, command)
                self.took_s[command] = time.monotonic() - began_s
            carry_on(home)
            ends[end_of(home)] = ", then ".join(" ".join(command) for command in order)
            shutil.rmtree(home)
        return ends


def stop(trial: int, attempt: int) -> None:
    """Ctrl-C in the second trial."""
    if trial == 2:
        raise KeyboardInterrupt


class Child:
    """A command in a process that waits until its gate is opened."""

    def __init__(self, home: Path, command: Sequence[str], delay_s: float = 0.0, *, interrupted: bool = False) -> None:
        self._log = home.parent / f"{home.name}-{time.monotonic_ns()}.log"
        reading, self._gate = os.pipe()
        self._pid = os.fork()
        if self._pid == 0:
            os.read(reading, 1)
            time.sleep(delay_s)
            try:
                code, said = call(home, command, ToyLab(7, hooks={"stop_recording": stop} if interrupted else {}))
            except BaseException:  # noqa: BLE001 whatever it is, this copy of the program ends here
                code, said = DEFECT, traceback.format_exc()
            self._log.write_text(said)
            os._exit(code)
        os.close(reading)

    def go(self) -> None:
        os.write(self._gate, b"!")
        os.close(self._gate)

    def wait(self) -> tuple[int, str]:
        """Its exit code and what it said."""
        _, status = os.waitpid(self._pid, 0)
        said = self._log.read_text()
        self._log.unlink()
        return os.waitstatus_to_exitcode(status), said


def done(home: Path, command: Sequence[str], *, interrupted: bool = False) -> tuple[int, str]:
    """The command in a process of its own, without a race."""
    child = Child(home, command, interrupted=interrupted)
    child.go()
    return child.wait()


def carry_on(home: Path) -> None:
    """To the end of the first iteration, as a person would who wants the session there."""
    root = home / "data" / "sessions"
    if not (root / "s").is_dir() or not SessionStore.open(root, "s").existing().shown:
        code, said = done(home, RUN)
        assert code == 0, said


def end_of(home: Path) -> str:
    """All that is stored, but for times of day and durations, as text."""
    return json.dumps(digest_of(home / "data" / "sessions"), sort_keys=True)


def left_behind(home: Path) -> list[str]:
    """Half-written and half-removed things that nobody will read."""
    hidden = [path for pattern in (TEMPORARY, ".*.deleted") for path in (home / "data").rglob(pattern)]
    return sorted(str(path.relative_to(home)) for path in hidden)


def run(race: Race, home: Path, delays_s: Sequence[float]) -> dict[str, Any]:
    pair = [Child(home, command, delay) for command, delay in zip(race.commands, delays_s, strict=True)]
    for child in pair:
        child.go()
    codes, said = zip(*[child.wait() for child in pair], strict=True)
    damage = [message for root in roots(home) for message in verify(root, "s").damage]
    carry_on(home)
    damage += verify(home / "data" / "sessions", "s").damage
    return {"codes": codes, "said": said, "damage": damage, "left": left_behind(home), "end": end_of(home)}


def roots(home: Path) -> list[Path]:
    """Where the session lies now: in the list, or nowhere."""
    root = home / "data" / "sessions"
    return [root] if (root / "s").is_dir() else []


def main(root: Path, races: int) -> None:
    homes, rng = Homes(root), np.random.default_rng(0)
    ends: dict[Race, dict[str, str]] = {}
    for number in range(races):
        race = RACES[number % len(RACES)]
        ends.setdefault(race, {} if race in ends else homes.alone(race))
        home = homes.copy(race.before, f"race-{number}")
        reach_s = max(homes.took_s[command] for command in race.commands)
        late_s = reach_s * rng.random() ** 3  # mostly close together
        delays_s = [0.0, late_s] if rng.random() < 0.5 else [late_s, 0.0]
        outcome = run(race, home, delays_s)
        outcome |= {"before": race.before, "race": [" ".join(command) for command in race.commands]}
        outcome["end"] = ends[race].get(outcome["end"])
        sys.stdout.write(json.dumps(outcome) + "\n")
        sys.stdout.flush()
        shutil.rmtree(home)


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]))
