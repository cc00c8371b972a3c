"""A person at a terminal beside an FR3: types the answers, holds the pedal, and lets go of it when a test says so."""

from __future__ import annotations

import errno
import fcntl
import json
import os
import pty
import select
import signal
import socket
import struct
import subprocess
import sys
import termios
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from fr3_process import Fr3Process, own_host
from gripper_server import GripperServer
from lab_session import WORLD, environment
from real_lab import HANDLE_M, calibration, waivers
from serial_lines import Box, Line

from adaptsim_cli import config
from adaptsim_cli.bench import calibration_in_use as wiring_calibration
from hw.types import Array
from sim.panda.planning import home
from sim.panda.tool import cell_as_shipped
from sim.tasks import get_task

PROGRAM = Path(__file__).with_name("fr3_program.py")
PATIENCE_S = 900.0
LIFTED_LINES = 15
LISTENS_S = 0.5
"""From the end of a question to the moment from which the program no longer throws away what is typed."""
HOLD = "Hold the pedal to let the arm move"
RIG = """\
name = "drill"
consent = "command"
[arm]
model = "fr3"
address = "{host}"
[pedal]
port = "{port}"
[person]
side = "left"
""" + waivers("keep_out", "payload", "stop_button", "slow_start")
START = "Type fr3 to let it move, q to stop, ? explains:"
ANSWERS = {
    "Your name goes into the record:": "Kim",
    "Type fr3 to confirm, q to stop, ? explains:": "fr3",
    "Type recover to clear it, Enter to leave it, q to stop, ? explains:": "recover",
    "Have you looked: is the arm at rest and its path clear? Type y to repeat this trial, q to stop, ? explains:": "y",
    START: "fr3",
    "Type y to start, q to stop, ? explains:": "y",
    "Enter when it lies there, q to stop, ? explains:": "",
    "Enter to accept, o to amend the outcome, r to reject it, q to stop, ? explains:": "",
}
"""What a person who wants to go on types, by how the question ends."""


class Pedal(Box):
    """The pedal's box at its end of a serial line; `port` stays the same when it is plugged in again."""

    def __init__(self, port: Path) -> None:
        self.port = port
        super().__init__(self._new_line())
        self.pressed = True

    def _new_line(self) -> Line:
        line = Line()
        os.set_blocking(line.device, False)  # what nobody reads is lost, as on a real line
        self.port.unlink(missing_ok=True)
        self.port.symlink_to(line.port)
        return line

    def plug_in(self) -> None:
        self.pressed, self.silent, self.line = True, False, self._new_line()

    def unplug(self) -> None:
        self.port.unlink(missing_ok=True)
        self.line.unplug()

    def release(self) -> None:
        self.pressed = False

    def press_anew(self) -> None:
        """Lift the foot, then press: what was held before a motion was asked for does not count."""
        self.pressed, self.lifted = False, LIFTED_LINES

    def fall_silent(self) -> None:
        self.silent = True

    def end(self) -> None:
        self.stop()
        self.unplug()


@dataclass(frozen=True)
class Ended:
    """A command that came to its end."""

    code: int
    said: str  # on the terminal, what was typed included
    data: list[dict[str, Any]]  # from stdout

    @property
    def error(self) -> str:
        """The message after the last "Error:", on one line."""
        return " ".join(self.said.rpartition("Error: ")[2].split())


@dataclass
class Drill:
    """One lab and its session. `server` is None while the arm is switched off."""

    home: Path
    world: Path
    host: str
    pedal: Pedal
    home_rad: Array  # (7,)
    server: Fr3Process | None = None
    hand: GripperServer | None = None  # that holds the tool
    motions: list[str] = field(default_factory=list)  # by name, of all commands

    @property
    def arm(self) -> Fr3Process:
        assert self.server is not None
        return self.server

    def calibrate(self, off_m: float = 0.0) -> None:
        """A new calibration is the rig's, its camera so far from where the lab has it."""
        asked = {"hw": "fr3", "task": "scooping"}
        there = config.load(asked, {"ADAPTSIM_HOME": str(self.home)}, self.world.parent)
        found = calibration()
        rows = [list(row) for row in found.X_AC]
        rows[0][3] += off_m
        moved = found.model_copy(update={"X_AC": tuple(map(tuple, rows))})
        wiring_calibration.calibrations(there.config, there.places).save(moved, b"")

    def switch_on(self) -> None:
        """The arm at home, where trials begin."""
        self.server = Fr3Process(self.host, self.home_rad, pace="hurried")
        self.hand = GripperServer(self.host, HANDLE_M, width_m=HANDLE_M, is_grasped=True)

    def switch_off(self) -> None:
        if self.server is not None:
            self.server.end()
            self.server = None
        if self.hand is not None:
            self.hand.end()
            self.hand = None

    def run(
        self,
        before: Before = lambda motion, command: None,
        answers: dict[str, str | Callable[[], str]] | None = None,
    ) -> Ended:
        """`adaptsim run-iteration` at a terminal of its own; `before(name, command)` is called before each motion."""
        arguments = ["run-iteration", "--task", "scooping", "--hw", "fr3", "--session", "s", "--json"]
        with Command(self, arguments, before, {**ANSWERS, **(answers or {})}) as command:
            ended = command.to_the_end()
        transcribe(f"\n======== exit code {ended.code}\n")
        return ended

    def completed(self) -> dict[str, bytes]:
        """Every completed trial's record by the name of its folder."""
        root = self.home / "data/sessions/s"
        return {path.parent.name: path.read_bytes() for path in sorted(root.glob("iteration-*/trial-*/trial.json"))}

    def rejected(self) -> list[str]:
        root = self.home / "data/sessions/s"
        return [json.loads(p.read_text())["text"] for p in sorted(root.glob("iteration-*/*.rejected.json"))]


class Command:
    """A running program, its terminal, and the person who answers."""

    def __init__(
        self, drill: Drill, arguments: list[str], before: Before, answers: dict[str, str | Callable[[], str]]
    ) -> None:
        self._drill, self._before, self._answers = drill, before, answers
        self._screen, ours = pty.openpty()
        fcntl.ioctl(ours, termios.TIOCSWINSZ, struct.pack("HHHH", 50, 500, 0, 0))
        self._cue, theirs = socket.socketpair()
        wide = {"TERM": "dumb", "COLUMNS": "500", "LINES": "50"}
        self._process = subprocess.Popen(
            [sys.executable, str(PROGRAM), str(theirs.fileno()), str(drill.world), "--", *arguments],
            stdin=ours,
            stdout=subprocess.PIPE,
            stderr=ours,
            env=environment(drill.home, **wide),
            cwd=drill.world.parent,
            pass_fds=[theirs.fileno()],
            start_new_session=True,
        )
        os.close(ours)
        theirs.close()
        self._said, self._answered, self._held = "", 0, 0
        self.fault = ""  # of the program's own devices, from the next motion on (`fr3_program.py`)

    def __enter__(self) -> Command:
        return self

    def __exit__(self, *exc: object) -> None:
        if self._process.poll() is None:
            self._process.kill()
        self._process.wait()
        self._cue.close()
        os.close(self._screen)
        assert self._process.stdout is not None
        self._process.stdout.close()

    def signal(self, number: signal.Signals) -> None:
        self._process.send_signal(number)

    def to_the_end(self) -> Ended:
        """Answer until the program ends. Fails when nothing is heard of it for `PATIENCE_S`."""
        heard = {self._screen, self._cue.fileno()}
        while self._screen in heard:
            ready, _, _ = select.select(sorted(heard), [], [], PATIENCE_S)
            assert ready, f"nothing happened for {PATIENCE_S:g} s; so far:\n{self._said}"
            if self._cue.fileno() in ready and not self._cued():
                heard.discard(self._cue.fileno())
            if self._screen in ready and not self._listened():
                heard.discard(self._screen)
        assert self._process.stdout is not None
        data = [json.loads(line) for line in self._process.stdout.read().decode().splitlines()]
        return Ended(self._process.wait(), self._said, data)

    def _cued(self) -> bool:
        motion = self._cue.recv(16).decode().strip()
        if not motion:
            return False
        self._drill.motions.append(motion)
        self._before(motion, self)
        self._cue.send(f"go {self.fault}\n".encode())
        return True

    def _listened(self) -> bool:
        try:
            heard = os.read(self._screen, 65536)
        except OSError as error:  # nobody holds the other end any more
            assert error.errno == errno.EIO
            return False
        said = heard.decode(errors="replace").replace("\r\n", "\n")
        self._said += said
        transcribe(said)
        for question, answer in self._answers.items():
            if question in self._said[self._answered :]:
                self._answered = len(self._said)
                time.sleep(LISTENS_S)
                typed = answer if isinstance(answer, str) else answer()
                os.write(self._screen, typed.encode() + b"\n")
        if HOLD in self._said[self._held :]:
            self._held = len(self._said)
            self._drill.pedal.press_anew()
        return True


def transcribe(said: str) -> None:
    """To the file that ADAPTSIM_DRILL_TRANSCRIPT names, where it names one: what is said, while it is said."""
    if kept := os.environ.get("ADAPTSIM_DRILL_TRANSCRIPT"):
        with Path(kept).open("a") as file:
            file.write(said)


Before = Callable[[str, Command], None]
"""Called with the name of a motion (home, approach, task, back) before it begins."""


@contextmanager
def drilling(folder: Path, world: str = WORLD) -> Iterator[Drill]:
    """A calibrated lab with its rig file, the arm switched on, the pedal held."""
    pedal = Pedal(folder / "pedal")
    pedal.start()
    drill = Drill(folder / "home", folder / "world.toml", own_host(), pedal, _home_rad())
    drill.world.write_text(world)
    (folder / "adaptsim.toml").write_text("particles = 1\n")
    (folder / "rig.toml").write_text(RIG.format(host=drill.host, port=pedal.port))
    drill.calibrate()
    drill.switch_on()
    try:
        yield drill
    finally:
        drill.switch_off()
        pedal.end()


def _home_rad() -> Array:
    task = get_task("scooping")
    hardware = task.require_hardware()
    return home(hardware.X_FT, cell_as_shipped(hardware, "fr3"), hardware.home_pitch_rad)


def until(condition: Callable[[], bool], within_s: float = 300.0) -> None:
    """Fails when it does not come to hold."""
    began_s = time.monotonic()
    while not condition():
        assert time.monotonic() - began_s < within_s, "it never came to hold"
        threading.Event().wait(0.005)
