"""The program's end of a child process. Requests go over a connection; meanwhile single words go over a pipe.

The child is a fresh process, never a fork, in its own Unix session: Ctrl-C on the terminal reaches the program, not the
child. The child notices the program's end by its pipes (`hw.watchdog`).
"""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

OWN_PACKAGES = str(Path(__file__).with_name("own_packages.py"))
"""The file that a fresh process runs first, by `runpy.run_path`: it finds our packages."""
END_S = 3.0
"""How long a child may take to end by itself: longer than the longest stop along a path."""


def python_module(module: str) -> tuple[str, ...]:
    """The command that runs one of our modules, also where the user has a folder or file of our packages' names."""
    return sys.executable, "-P", OWN_PACKAGES, module


@dataclass(frozen=True)
class Call:
    """A request to another process: the name of a method, and its arguments."""

    method: str
    arguments: tuple[Any, ...] = ()


class ChildGone(Exception):
    """The process has ended; the message says how."""


class Child:
    """A running process `module CONNECTION PIPE arguments`; the first two arguments are file descriptors."""

    def __init__(self, module: str, *arguments: str, end_s: float = END_S) -> None:
        self._end_s = end_s
        ours, theirs = socket.socketpair()
        listen, self._say = os.pipe()
        os.set_blocking(self._say, False)
        self._process = subprocess.Popen(
            [*python_module(module), str(theirs.fileno()), str(listen), *arguments],
            pass_fds=(theirs.fileno(), listen),
            stdin=subprocess.DEVNULL,
            start_new_session=True,
        )
        theirs.close()
        os.close(listen)
        self.connection = Connection(ours.detach())

    @property
    def pid(self) -> int:
        """The process number."""
        return self._process.pid

    @property
    def alive(self) -> bool:
        """Whether it runs."""
        return self._process.poll() is None

    def send(self, request: object) -> None:
        """Raises ChildGone."""
        try:
            self.connection.send(request)
        except OSError as error:
            raise self._gone() from error

    def answers(self, within_s: float) -> bool:
        """Whether an answer, or the end of the process, comes in time."""
        return self.connection.poll(within_s)

    def receive(self) -> Any:
        """The next answer, waited for. Raises ChildGone."""
        try:
            return self.connection.recv()
        except (EOFError, OSError) as error:
            raise self._gone() from error

    def send_word(self, word: bytes) -> None:
        """Write a word to the pipe; never waits."""
        with suppress(BlockingIOError, BrokenPipeError):  # full: it knows already; broken: the answer will say so
            os.write(self._say, word)

    def close(self) -> None:
        """Close the pipes, which tells the process to end; kill it if it does not."""
        self.connection.close()
        os.close(self._say)
        try:
            self._process.wait(self._end_s)
        except subprocess.TimeoutExpired:
            self.kill()

    def kill(self) -> None:
        """End the process at once."""
        self._process.kill()
        self._process.wait()

    def _gone(self) -> ChildGone:
        try:
            code = self._process.wait(self._end_s)
        except subprocess.TimeoutExpired:
            self.kill()
            return ChildGone("hanging and has been killed")
        return ChildGone(f"killed by {signal.Signals(-code).name}" if code < 0 else f"ended with status {code}")
