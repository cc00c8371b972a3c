"""`--speak`: questions and warnings aloud, for a person who stands at the table and not at the keyboard."""

from __future__ import annotations

import queue
import re
import shutil
import subprocess
import threading

from adaptsim_cli.errors import UsageError

PROGRAMS = {"espeak-ng": ("--",), "spd-say": ("--wait", "--")}
"""The programs that can speak, in the order of preference, with their options."""
_KEYS = re.compile(r"(?<=[.?]) [^.?]*, \? explains:$")


class Speaker:
    """`console.Listener`: speaks one text after the other; a question cuts off what was said before it."""

    def __init__(self) -> None:
        """Raises UsageError if no program of this computer speaks."""
        found = next((name for name in PROGRAMS if shutil.which(name)), None)
        if found is None:
            raise UsageError("--speak: nothing here can speak. Install it: sudo apt-get install -y espeak-ng")
        self._command = (found, *PROGRAMS[found])
        self._left: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._speaking: subprocess.Popen[bytes] | None = None
        threading.Thread(target=self._speak, name="speaker", daemon=True).start()

    def doing(self, what: str, stage: str) -> None:
        """See `console.Listener`; says nothing."""

    def did(self, what: str, stage: str, took_s: float) -> None:
        """See `console.Listener`; says nothing."""

    def asking(self, question: str) -> None:
        """See `console.Listener`; says the question without its keys."""
        while not self._left.empty():
            self._left.get()
        if self._speaking is not None:
            self._speaking.terminate()
        self._left.put(_KEYS.sub("", question))

    def answered(self, question: str, answer: str, took_s: float) -> None:
        """See `console.Listener`; says nothing."""

    def noted(self, text: str) -> None:
        """See `console.Listener`; says the warning."""
        self._left.put(text)

    def _speak(self) -> None:
        while True:
            said = [*self._command, self._left.get()]
            self._speaking = subprocess.Popen(said, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            self._speaking.wait()
