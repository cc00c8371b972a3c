"""Film a practised setup in a terminal of 80 x 24; it really runs, and every question is answered.

    python docs/film.py

It writes docs/figures/setup.cast (asciinema play FILE). Waits longer than a second are cut to one, also those with a
turning wheel; nothing else is changed.
"""

from __future__ import annotations

import fcntl
import json
import os
import pty
import re
import select
import struct
import sys
import tempfile
import termios
import time
from collections.abc import Sequence
from pathlib import Path

COLUMNS, ROWS, LONGEST_WAIT_S = 80, 24, 1.0
ROOT = Path(__file__).parents[1]
PROMPT = "$ "
CAST = ROOT / "docs/figures/setup.cast"
WHEEL = re.compile(r"\r\x1b\[2K[⠀-⣿] ([^\x1b]*)\x1b\[1m\d+ s\x1b\[0m")
"""One turn of the wheel beside a step, with its seconds."""
ANSWERS = {"Name a box": "lamp", "upper corner": "0.7 -0.7 0.5"}
"""Typed once each, at the question that has these words in it; a motion gets the word it asks for, the rest Enter."""


def main() -> int:
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        (place / "adaptsim").symlink_to(ROOT)
        events = film(place, ("adaptsim setup --world oreo",))
        events = without_waits(events)
        write_cast(CAST, "adaptsim: a setup, practised", events)
    print(f"{CAST.relative_to(ROOT)}: {events[-1][0]:.0f} s")
    return 0


def without_waits(events: Sequence[tuple[float, str]]) -> list[tuple[float, str]]:
    """The events with at most `LONGEST_WAIT_S` of turns of the same wheel."""
    kept, cut_s, step, since_s, last_s = list[tuple[float, str]](), 0.0, "", 0.0, 0.0
    for t_s, text in events:
        wheel = WHEEL.fullmatch(text)
        if wheel is None or wheel[1] != step:
            step, since_s = wheel[1] if wheel else "", t_s
        if wheel and t_s - since_s > LONGEST_WAIT_S:
            cut_s += t_s - last_s
        else:
            kept.append((t_s - cut_s, text))
        last_s = t_s
    return kept


def write_cast(path: Path, title: str, events: Sequence[tuple[float, str]]) -> None:
    """A file for asciinema."""
    header = {"version": 2, "width": COLUMNS, "height": ROWS, "title": title}
    lines = [json.dumps(header), *(json.dumps([round(t_s, 2), "o", text]) for t_s, text in events)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def film(place: Path, typed: Sequence[str]) -> list[tuple[float, str]]:
    """(time in s, output) of all commands, as a terminal gets it; all data lie in `place`."""
    (place / ".inputrc").write_text("set enable-bracketed-paste off\n")
    process, fd = pty.fork()
    if process == 0:
        os.chdir(place)
        kept = {name: os.environ[name] for name in ("PATH", "LANG") if name in os.environ}
        path = f"{Path(sys.executable).parent}:{kept.get('PATH', '')}"
        mine = {"HOME": str(place), "ADAPTSIM_HOME": str(place / "data"), "TERM": "xterm-256color", "PS1": PROMPT}
        mine |= {"PATH": path, "PYTHONPATH": str(place / "adaptsim")}
        os.execve("/bin/bash", ["bash", "--norc", "--noprofile"], {**kept, **mine})
    fcntl.ioctl(fd, termios.TIOCSWINSZ, struct.pack("HHHH", ROWS, COLUMNS, 0, 0))
    events: list[tuple[float, str]] = []
    clock_s = _until_prompt(fd, events, 0.0)
    for command in typed:
        for key in command:
            os.write(fd, key.encode())
            time.sleep(0.02)
        os.write(fd, b"\n")
        clock_s = _until_prompt(fd, events, clock_s + 0.5, after=command)
    os.write(fd, b"exit\n")
    os.close(fd)
    os.waitpid(process, 0)
    private = str(place)
    return [(t_s, text.replace(private, "~")) for t_s, text in events]


def _until_prompt(fd: int, events: list[tuple[float, str]], clock_s: float, after: str = "") -> float:
    """Read until the shell asks again; returns the film's clock. Raises TimeoutError after twenty minutes.

    A line that ends with a colon, and a second of silence, is a question: it is answered from `ANSWERS`.
    """
    seen, last_s, deadline_s = "", time.monotonic(), time.monotonic() + 1200.0
    left, answered = dict(ANSWERS), 0
    while time.monotonic() < deadline_s:
        if not select.select([fd], [], [], 1.0)[0]:
            if re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", seen[answered:]).rstrip().endswith(":"):
                question = " ".join(re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", seen[answered:]).split())
                key = next((words for words in left if words in question), "")
                word = re.findall(r"Type (\w+) to (?:start|let|confirm)", question)
                answered = len(seen)
                os.write(fd, (left.pop(key) if key else word[-1] if word else "").encode() + b"\n")
            continue
        text = os.read(fd, 65536).decode("utf-8", "replace")
        now_s = time.monotonic()
        clock_s += min(now_s - last_s, LONGEST_WAIT_S)
        last_s = now_s
        events.append((clock_s, text))
        seen += text
        answer = seen.partition(after)[2] if after else f"\n{seen}"
        if answer.endswith(f"\n{PROMPT}"):
            return clock_s
    raise TimeoutError(f"{after}: no prompt within twenty minutes; seen: {seen[-500:]}")


if __name__ == "__main__":
    sys.exit(main())
