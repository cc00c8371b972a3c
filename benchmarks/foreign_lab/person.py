"""The person in the foreign lab: reads the screen, does by hand what it asks for, and types the answers."""

from __future__ import annotations

import fcntl
import json
import os
import pty
import re
import select
import struct
import subprocess
import sys
import termios
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import postures
from world import Line, Room

PROGRAM = Path(__file__).with_name("program.py")
SILENCE_S = 600.0
QUESTION = re.compile(r"(?:explains:|record:|stops\):)\s*$")
SPOT = re.compile(r"at x = ([-+.\d]+) m, y = ([-+.\d]+) m")
SET_DOWN = re.compile(
    r"Place \d+ of \d+: the (edge|rear end) .*?\(about (\d+)°\), about ([\d.]+) cm ahead of the base, (.*?)\."
)
PLACED_WITHIN_M = 0.002
THINKS_S = 1.0  # keys pressed before a question are discarded
ENOUGH = 20  # views, where the program has nothing more to ask for
LATELY = 200  # characters of the screen that belong to a question


@dataclass
class Person:
    """One pair of hands. `postures` are where the arm is guided to in a calibration, one after the other."""

    arm: Line
    task: str
    postures: list[list[float]]
    room: Room | None = None  # where the hands feel how the tool lies on the table
    seed: int = 0
    asked: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._rng = np.random.default_rng(self.seed)

    @property
    def tool(self) -> str:
        return "spatula" if self.task == "scooping" else "pusher"

    @property
    def object(self) -> str:
        return "piece" if self.task == "scooping" else "bottle"

    def answer(self, question: str, said: str) -> str:
        """Do what the question asks for. -> the answer to type. Stops at an unknown question."""
        self.asked.append(question)
        for words, reply in REPLIES.items():
            if words in question:
                return reply(self, said) if callable(reply) else reply
        return "q"

    def guide(self, said: str) -> str:
        number = int(said.rpartition("Place ")[2].partition(".")[0])
        if number > len(self.postures) or (number > ENOUGH and "s to solve" in said):
            return "s"
        self.arm.ask(do="guide", q=self.postures[number - 1])
        time.sleep(0.5)
        return ""

    def set_down(self, said: str) -> str:
        """Set the tool down as the question says, and let go."""
        words = " ".join(said.split())
        end, degrees, x_cm, aside = SET_DOWN.findall(words)[-1]
        offset = re.match(r"([\d.]+) cm to the (left|right)", aside)
        y_m = 0.0 if offset is None else 0.01 * float(offset[1]) * (1.0 if offset[2] == "left" else -1.0)
        pitch_rad = np.radians(float(degrees)) * (1.0 if end == "edge" else -1.0)
        assert self.room is not None
        joints = postures.set_down(self.room, end, pitch_rad, (0.01 * float(x_cm), y_m), self._rng)
        self.arm.ask(do="guide", q=joints)
        time.sleep(1.0)
        return ""

    def place(self, said: str) -> str:
        x, y = map(float, SPOT.findall(" ".join(said.split()))[-1])
        off = PLACED_WITHIN_M * self._rng.uniform(-1.0, 1.0, 2)
        self.arm.ask(do="put", what=self.object, xy=[x + off[0], y + off[1]], yaw=self._rng.uniform(-3.0, 3.0))
        time.sleep(0.5)
        return ""

    def empty(self, said: str) -> str:
        self.arm.ask(do="hold", what="nothing")
        return ""

    def hand_over(self, said: str) -> str:
        self.arm.ask(do="hold", what=self.tool, width=0.06)
        return "y"


REPLIES: dict[str, str | Callable[[Person, str], str]] = {
    "Enter when the arm is at rest": Person.guide,
    "Enter to read the joints": Person.set_down,
    "n to leave this out": "n",
    "Your name goes into the record": "Kim",
    "Type fr3 to confirm": "fr3",
    "Type recover to clear it": "recover",
    "Enter to begin it": "",
    "Enter when it is empty": Person.empty,
    "the hand closes with": Person.hand_over,
    "Enter when it lies there": Person.place,
    "Enter to set this trial up again": "",
    "Enter to repeat this trial": "",
    "to overrule the outcome": "",
    "Enter to accept": "",
    "Type y to repeat this trial": "y",
    "Type fr3 to let it move": "fr3",
    "Type y to start": "y",
}


@dataclass(frozen=True)
class Ended:
    """A command that came to its end."""

    code: int
    said: str
    data: list[dict[str, Any]]


def run(folder: Path, arguments: list[str], person: Person, environment: dict[str, str], log: Path) -> Ended:
    """One command of the program at a terminal of its own, to its end."""
    screen, ours = pty.openpty()
    fcntl.ioctl(ours, termios.TIOCSWINSZ, struct.pack("HHHH", 50, 400, 0, 0))
    process = subprocess.Popen(
        [sys.executable, str(PROGRAM), str(folder), *arguments],
        stdin=ours, stdout=subprocess.PIPE, stderr=ours, cwd=folder, env=environment, start_new_session=True,
    )  # fmt: skip
    os.close(ours)
    said, answered, heard_s = "", 0, time.monotonic()
    with log.open("a") as file:
        file.write(f"\n$ adaptsim {' '.join(arguments)}\n")
        while time.monotonic() - heard_s < SILENCE_S:
            ready, _, _ = select.select([screen], [], [], 1.0)
            if not ready:
                if process.poll() is not None:
                    break
                continue
            try:
                heard = os.read(screen, 65536).decode(errors="replace").replace("\r\n", "\n")
            except OSError:
                break
            heard_s = time.monotonic()
            said += heard
            file.write(heard)
            file.flush()
            new = said[answered:]
            if QUESTION.search(new):
                question = " ".join(new.split())[-LATELY:]
                typed = person.answer(question, new)
                answered = len(said)
                time.sleep(THINKS_S)
                os.write(screen, typed.encode() + b"\n")
        else:
            process.kill()
        assert process.stdout is not None
        out = process.stdout.read().decode()
        code = process.wait()
        file.write(f"\n[exit code {code}]\n{out}\n")
    os.close(screen)
    lines = [line for line in out.splitlines() if line.startswith("{")]
    return Ended(code, said, [json.loads(line) for line in lines])
