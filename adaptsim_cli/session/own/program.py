"""A program that answers: it gets the question on stdin, and its output holds the answer.

It runs in a session of its own, so that neither Ctrl-C nor the end of adaptsim reaches it: a program in the middle of a
motion is never stopped by us. A lock that it inherits tells a later command that it is still running.
"""

from __future__ import annotations

import fcntl
import os
import shlex
import subprocess
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from adaptsim_cli.errors import AnswerRefused, UsageError
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.screen.keys import Key, stop
from adaptsim_cli.screen.outputs.exchange import Question
from adaptsim_cli.screen.release import Release
from adaptsim_cli.session.own.exchange import Exchange
from adaptsim_cli.session.own.reading import MOST_BYTES
from sim.adaptation.sessions import Progress

_RUN = 'q=$1; r=$2; shift 2; "$@" <"$q" >"$r.out" 2>"$r.err"; echo $? >"$r.exit.part"; mv "$r.exit.part" "$r.exit"'
"""Shell script that runs a program, and notes its end even if the caller has gone."""
_STARTED: list[subprocess.Popen[bytes]] = []
"""Processes that may still run. They outlive this program, so it does not wait for them."""
_LOOK_S = 0.05
"""How often to look whether a program has ended."""
YOURS = "It moves YOUR robot; adaptsim checks none of its motion"


@dataclass(frozen=True)
class Program:
    """An `Answerer`: a command line."""

    command: str
    moves: bool
    limit_s: float  # after which the person is asked
    screen: Screen | None  # None: nobody can be asked
    release: Release = field(default_factory=Release)
    pause: Callable[[float], None] = time.sleep

    @property
    def title(self) -> str:
        """See `Answerer`."""
        return f"program `{self.command}`"

    @property
    def needs_consent(self) -> bool:
        """See `Answerer`."""
        return self.moves

    @property
    def announcement(self) -> str:
        """See `Answerer`."""
        check = "Check that its work area is clear and that nobody is within reach"
        return f"The program `{self.command}` runs{f'. {YOURS}. {check}' if self.moves else ', which moves nothing'}"

    @property
    def then(self) -> str:
        """See `Answerer`."""
        return "The program starts at once. Ctrl-C does not stop it, only your robot's own stop button does."

    def ask(self, exchange: Exchange, question: Question, progress: Progress) -> None:
        """See `Answerer`. A program that an earlier command started is waited for, and not run twice."""
        run = _newest(exchange)
        if run is None or not (run.is_running or run.has_answered):
            if run is not None:
                self._note(f"Trial {question.trial} is asked again: its program ended without an answer.")
            what = f"makes trial {question.trial}. {YOURS}" if self.moves else "answers"
            self.release.take(exchange.digest, what)
            run = self._start(exchange)
        elif run.is_running:
            self._note(f"The program of trial {question.trial} is still running, and the session waits for its answer.")
        with progress("Waiting for the program", "moving"):
            over = self._wait(run)
        while not over:
            self._ask_whether_to_wait()
            with progress("Waiting for the program", "moving"):
                over = self._wait(run)
        _take(exchange, run, question.trial)

    def _note(self, text: str) -> None:
        if self.screen is not None:
            self.screen.note(text)

    def _start(self, exchange: Exchange) -> Run:
        try:
            words = shlex.split(self.command)
        except ValueError as error:
            raise UsageError(f"answer_with = {self.command!r}: {error}") from error
        if not words:
            raise UsageError("answer_with is empty: name the command of your program")
        run = Run(exchange.folder / f"{exchange.ask}.run-{_count(exchange) + 1}")
        lock = os.open(run.lock, os.O_CREAT | os.O_RDWR | os.O_CLOEXEC, 0o644)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX)
            os.set_inheritable(lock, True)
            command = ["sh", "-c", _RUN, "adaptsim", str(exchange.question_file), str(run.stem), *words]
            _STARTED[:] = [process for process in _STARTED if process.poll() is None]
            _STARTED.append(
                subprocess.Popen(
                    command,
                    start_new_session=True,
                    pass_fds=(lock,),
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.DEVNULL,
                    env={**os.environ, "PYTHONDONTWRITEBYTECODE": "1"},  # a new file there would end its trust
                )
            )
        finally:
            os.close(lock)
        return run

    def _wait(self, run: Run) -> bool:
        """Whether it ended within the limit."""
        end_s = time.monotonic() + self.limit_s
        while run.is_running:
            if time.monotonic() >= end_s:
                return False
            self.pause(_LOOK_S)
        return True

    def _ask_whether_to_wait(self) -> None:
        silent = f"the program has not answered within {self.limit_s:g} s (answer_limit_s)"
        late = f"{silent}; it continues, and nothing stops it"
        if self.screen is None or not self.moves:
            raise AnswerRefused(f"{late}. The same command takes its answer later")
        self.screen.note(f"{late[0].upper()}{late[1:]}.")
        on = Key("w", "to wait on", "The program continues, and the session waits for its answer.")
        leave = stop(
            "This command ends. The program continues; the same command takes its answer, and does not run it again."
        )
        if self.screen.choose("Wait on?", on, leave) == "q":
            raise AnswerRefused(f"{late}. The same command takes its answer later")


@dataclass(frozen=True)
class Run:
    """One run of a program."""

    stem: Path

    @property
    def out(self) -> Path:
        """Output of the program."""
        return Path(f"{self.stem}.out")

    @property
    def exit(self) -> Path:
        """Exit code of the program, once it has ended."""
        return Path(f"{self.stem}.exit")

    @property
    def lock(self) -> Path:
        """Held as long as it runs."""
        return Path(f"{self.stem}.lock")

    @property
    def receipt(self) -> Path:
        """This file exists once the output was taken as an answer. If a person deletes it, the program runs again."""
        return Path(f"{self.stem}.taken")

    @property
    def has_answered(self) -> bool:
        """Whether it ended well, with an output that was not taken yet."""
        return (
            not self.receipt.exists()
            and self.exit.exists()
            and self.exit.read_text().strip() == "0"
            and self.out.stat().st_size > 0
        )

    @property
    def is_running(self) -> bool:
        """Whether it has not ended yet."""
        if self.exit.exists():
            return False
        try:
            lock = os.open(self.lock, os.O_RDWR | os.O_CLOEXEC)
        except FileNotFoundError:
            return False
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
        finally:
            os.close(lock)
        return False


def _count(exchange: Exchange) -> int:
    return len(list(exchange.folder.glob(f"{exchange.ask}.run-*.lock")))


def _newest(exchange: Exchange) -> Run | None:
    count = _count(exchange)
    return Run(exchange.folder / f"{exchange.ask}.run-{count}") if count else None


def _take(exchange: Exchange, run: Run, trial: int) -> None:
    """Keep the answer of a run that is over. Raises AnswerRefused."""
    here = (
        f"Its output is kept in {run.out}. If the trial was made, write its answer to {exchange.answer_file}; else the "
        "same command asks again"
    )
    if not run.exit.exists():
        raise AnswerRefused(
            f"the program of trial {trial} was killed, or the computer stopped, before it answered. {here}"
        )
    code = run.exit.read_text().strip()
    if code != "0":
        raise AnswerRefused(
            f"the program of trial {trial} ended with exit code {code}{_meaning(code)}{_last(run)}. {here}"
        )
    size = run.out.stat().st_size
    if size == 0:
        raise AnswerRefused(f"the program of trial {trial} ended without an output{_last(run)}. {here}")
    if size > MOST_BYTES:
        raise AnswerRefused(
            f"the program of trial {trial} printed {size / 2**20:.0f} MB, limit {MOST_BYTES // 2**20}. {here}"
        )
    exchange.keep(run.out.read_bytes())
    run.receipt.touch()


def _meaning(code: str) -> str:
    meanings = {"127": " (no such command)", "126": " (it may not be executed)"}
    if code in meanings:
        return meanings[code]
    return f" (killed by signal {int(code) - 128})" if code.isdigit() and int(code) > 128 else ""


def _last(run: Run) -> str:
    """The last line of its errors."""
    with Path(f"{run.stem}.err").open("rb") as file:
        file.seek(max(0, os.fstat(file.fileno()).st_size - 2000))
        lines = file.read().decode("utf-8", "replace").strip().splitlines()
    return f": {lines[-1][:200]}" if lines else ""
