"""A simulator that is a program. It reads a JSON object and prints one, like the program of your own robot."""

from __future__ import annotations

import atexit
import json
import queue
import shlex
import subprocess
import sys
import tempfile
import threading
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

import numpy as np

from hw.types import Array
from sim.errors import TaskError
from sim.own.values import Values

_GRACE_S = 1.0
"""A program that has not answered by then may be waiting for the end of its input, so its input is closed."""
_SHOWN = 400


def program(command: str, *, keep: bool | None = None, limit_s: float = 600.0) -> SimulatorProgram:
    """A simulator as a program: `program("./my_sim")(p, context, action)` returns times and states.

    It gets one line on stdin, `{"parameters": {...}, "context": {...}, "action": {...}}`, and prints an object with
    `t_s` (N numbers) and `state` (N rows), or with `error`. It runs in the folder of the task's file. A program that
    answers and stays is asked again; one that reads its input to the end runs once for each rollout. `keep` states
    which of the two it is, if that is known. Raises TaskError if it fails, or is silent for `limit_s`.
    """
    try:
        words = shlex.split(command)
    except ValueError as error:
        raise TaskError(f"program {command!r}: {error}") from error
    if not words:
        raise TaskError("program: name the command of your simulator, as './my_sim --fast'")
    folder = Path(sys._getframe(1).f_globals.get("__file__", "x")).absolute().parent
    return SimulatorProgram(tuple(words), folder, limit_s, _Mode(keep))


@dataclass
class _Mode:
    """Whether the program stays after an answer (None: not known yet), and the process that stays."""

    keep: bool | None
    running: _Running | None = None


@dataclass(frozen=True, eq=False)
class SimulatorProgram:
    """See `program`."""

    words: tuple[str, ...]
    folder: Path
    limit_s: float
    mode: _Mode
    lock: Any = field(default_factory=threading.Lock)
    physics: str = field(default="program", init=False)

    def __call__(self, *values: Any, **named: Any) -> tuple[Array, Array | dict[str, Array]]:
        """One rollout with `p`, `context` and `action`, as the task's function gets them.

        Times (N,) and states: rows (N, k) in the order of the task's columns, or (N,) for each name, as it answers.
        """
        question = dict[str, Any]()
        for key, value in [*((_role(one), one) for one in values), *named.items()]:
            question["parameters" if key == "p" else key] = _plain(value)
        with self.lock:
            answer = self._answered(question)
        if "error" in answer:
            raise TaskError(f"{self.title} reports an error: {answer['error']}")
        if "t_s" not in answer or "state" not in answer:
            raise TaskError(f"{self.title} answers {', '.join(answer) or 'nothing'}: it must answer t_s and state")
        state = answer["state"]
        by_name = isinstance(state, Mapping)
        rows = {name: self._numbers(name, state[name]) for name in state} if by_name else self._numbers("state", state)
        return self._numbers("t_s", answer["t_s"]), rows

    def _numbers(self, what: str, values: Any) -> Array:
        try:
            return np.array(values, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise TaskError(f"{self.title} answers {what} that are not numbers of one shape: {error}") from error

    @property
    def title(self) -> str:
        """The program in a sentence."""
        return f"the program `{shlex.join(self.words)}`"

    def _answered(self, question: Mapping[str, Any]) -> Mapping[str, Any]:
        process, self.mode.running = self.mode.running, None
        if process is not None and not process.over:
            try:
                return self._asked(process, question)
            except _Gone:  # it answered once, and ended while it was asked again: it runs once for each rollout
                self.mode.keep = False
        return self._asked(_Running.of(self.words, self.folder, self.title), question)

    def _asked(self, process: _Running, question: Mapping[str, Any]) -> Mapping[str, Any]:
        """The answer of a process. Raises TaskError; _Gone if it has answered before, and ended without another one."""
        try:
            process.ask(json.dumps(question))
            if self.mode.keep is False:
                process.close_input()
            answer = process.answer(_GRACE_S if self.mode.keep is None else self.limit_s)
            if answer is None and self.mode.keep is None:
                process.close_input()
                answer = process.answer(self.limit_s)
                self.mode.keep = False if answer is not None else None
        except BaseException:
            process.end()
            raise
        if answer is None:
            process.end()
            raise TaskError(f"{self.title} has not answered within {self.limit_s:g} s")
        if self.mode.keep is False:
            process.end()
        else:
            self.mode.running = process
        return answer


class _Gone(TaskError):
    """A process that answered an earlier question ended without a word about this one."""


@dataclass(eq=False)
class _Running:
    """One process of the program."""

    title: str
    process: subprocess.Popen[str]
    errors: IO[bytes]
    lines: queue.Queue[str | None]
    text: list[str] = field(default_factory=list)  # about the present question
    answers: int = 0

    @classmethod
    def of(cls, words: tuple[str, ...], folder: Path, title: str) -> _Running:
        """Start it. Raises TaskError."""
        errors = tempfile.TemporaryFile()  # noqa: SIM115 - closed at the end of the process
        pipe = subprocess.PIPE
        try:
            process = subprocess.Popen(words, cwd=folder, stdin=pipe, stdout=pipe, stderr=errors, text=True)
        except OSError as error:
            errors.close()
            raise TaskError(f"{title} cannot be started in {folder}: {error.strerror}") from error
        lines: queue.Queue[str | None] = queue.Queue()

        def read() -> None:
            assert process.stdout is not None
            with process.stdout:  # nobody else closes it, because a file that is being read must stay open
                for line in process.stdout:
                    lines.put(line)
            lines.put(None)

        threading.Thread(target=read, name="program", daemon=True).start()
        running = cls(title, process, errors, lines)
        atexit.register(running.end)
        return running

    @property
    def over(self) -> bool:
        """Whether it has ended."""
        return self.process.poll() is not None

    def ask(self, question: str) -> None:
        """Send one line. Raises TaskError."""
        self.text.clear()
        assert self.process.stdin is not None
        try:
            self.process.stdin.write(question + "\n")
            self.process.stdin.flush()
        except OSError as error:
            raise self._failed() from error

    def close_input(self) -> None:
        """Tell the program that there are no more questions."""
        assert self.process.stdin is not None
        self.process.stdin.close()

    def answer(self, limit_s: float) -> Mapping[str, Any] | None:
        """The object that it prints in one line, or in several until its end; None after the limit."""
        while True:
            try:
                line = self.lines.get(timeout=limit_s)
            except queue.Empty:
                return None
            if line is None:
                return self._whole()
            self.text.append(line)
            if (answer := _object(line)) is not None:
                self.answers += 1
                return answer

    def _whole(self) -> Mapping[str, Any]:
        if (answer := _object("".join(self.text))) is None:
            raise self._failed()
        return answer

    def _failed(self) -> TaskError:
        code = self.process.wait(timeout=10.0)
        self.errors.seek(0)
        message = self.errors.read().decode(errors="replace").strip() or "".join(self.text).strip()
        last = f": {message.splitlines()[-1][:_SHOWN]}" if message else ""
        silent = self.answers and not code and not message
        kind = _Gone if silent else TaskError
        return kind(f"{self.title} ended with exit code {code} and gave no JSON object{last}")

    def end(self) -> None:
        """End it, if it still runs."""
        atexit.unregister(self.end)
        if self.process.stdin is not None and not self.process.stdin.closed:
            with suppress(OSError):  # it has gone
                self.process.stdin.close()
        if self.process.poll() is None:
            self.process.terminate()
            try:
                self.process.wait(timeout=2.0)
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.wait()
        self.errors.close()


def _object(text: str) -> Mapping[str, Any] | None:
    try:
        value = json.loads(text)
    except ValueError:
        return None
    return value if isinstance(value, dict) else None


def _role(value: Any) -> str:
    if not isinstance(value, Values):
        raise TaskError(f"a program takes p, context and action as the task's function gets them, not {value!r}")
    return str(value._role)


def _plain(value: Any) -> Any:
    """A value as JSON has it."""
    pairs = value if isinstance(value, Values) else value.items() if isinstance(value, Mapping) else None
    if pairs is not None:
        return {key: _plain(one) for key, one in pairs}
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else value
