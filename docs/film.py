"""Film a first session in a terminal of 80 x 24, from clone to report: the commands really run.

    python docs/film.py
    python docs/film.py setup

The second one practises a setup and answers every question: docs/figures/setup.cast and docs/start/setup.md.

The first one writes docs/figures/first-session.cast (asciinema play FILE), and what stands in the terminal at the end as a page,
docs/start/film.md, and as a picture, docs/figures/first-session.svg. Needs git and tmux; tmux is the terminal that
turns the stream into text. Waits longer than a second are cut to one; nothing else is changed.
"""

from __future__ import annotations

import fcntl
import io
import json
import os
import pty
import re
import select
import shutil
import struct
import subprocess
import sys
import tempfile
import termios
import time
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.text import Text

COLUMNS, ROWS, LONGEST_WAIT_S = 80, 24, 1.0
ROOT = Path(__file__).parents[1]
CAST, PICTURE = ROOT / "docs/figures/first-session.cast", ROOT / "docs/figures/first-session.svg"
PAGE = ROOT / "docs/start/film.md"
PROMPT = "$ "
ADDRESS = "https://example.org/adaptsim.git"
"""Stands for wherever the project lives; the film clones this checkout."""
HEAD = """# A first session, filmed

Written by `python docs/film.py`, which types these commands into a terminal of 80 × 24 and runs them.
[The film](../figures/first-session.cast) plays with `asciinema play first-session.cast`; waits are cut to one second. [The same as a picture](../figures/first-session.svg).
`make setup` is left out: it downloads for minutes. The address of the clone stands for that of the project.
The task is the pendulum, which needs no arm and takes seconds. [The first session](first-session.md) does the same with the simulated robot.
The verdict is right that no parameters in the ranges explain this pendulum: `ood-1` lies outside of them, and `adaptsim` corrects the action for that. The last trials confirm what was predicted.

"""


def commands(clone: Path) -> tuple[str, ...]:
    """Typed one after the other; each runs to its end."""
    return (
        f"git clone --quiet {ADDRESS} {clone.name}",
        f"cd {clone.name}",
        "adaptsim doctor --task pendulum",
        "adaptsim run-iteration --task pendulum --world ood-1 --session first --yes",
        "adaptsim run-iteration --session first --yes",
        "adaptsim sessions show first",
        "adaptsim rollout --session first --best --trials 2 --yes",
        "adaptsim report first",
    )


SETUP_PAGE, SETUP_CAST = ROOT / "docs/start/setup.md", ROOT / "docs/figures/setup.cast"
SETUP_HEAD = """# A setup, practised

Written by `python docs/film.py setup`, which types this command into a terminal of 80 × 24 and answers its questions: mostly with Enter, which takes what stands in brackets, and with the word that lets something move.
[The film](../figures/setup.cast) plays with `asciinema play setup.cast`; waits are cut to one second.
With a real arm, `adaptsim setup --hw fr3`, the first five steps ask and look at the devices. Of every step the middle is left out here (…).

"""
ANSWERS = {"Name a box": "lamp", "upper corner": "0.7 -0.7 0.5"}
"""Typed once each, at the question that has these words in it; a motion gets the word it asks for, the rest Enter."""
FIRST, LAST = 14, 5
"""Lines of a step that the page keeps."""


def setup() -> int:
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        (place / "adaptsim").symlink_to(ROOT)
        events = film(place, ("adaptsim setup --world oreo",))
        write_cast(SETUP_CAST, "adaptsim: a setup, practised", events)
        shown = screen("".join(text for _, text in events), place)
    steps = re.split(r"\n(?=\d+ of \d+  [a-z])", plain(shown))
    SETUP_PAGE.write_text(f"{SETUP_HEAD}```text\n{chr(10).join(map(shortened, steps))}\n```\n", encoding="utf-8")
    print(f"{SETUP_PAGE.relative_to(ROOT)}: {events[-1][0]:.0f} s")
    return 0


def shortened(step: str) -> str:
    lines = step.splitlines()
    return step if len(lines) <= FIRST + LAST else "\n".join([*lines[:FIRST], "…", *lines[-LAST:], ""])


def main() -> int:
    if sys.argv[1:] == ["setup"]:
        return setup()
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        events = film(place, commands(place / "adaptsim"))
        write_cast(CAST, "adaptsim: a first session", events)
        shown = screen("".join(text for _, text in events), place)
    PAGE.write_text(f"{HEAD}```text\n{plain(shown)}\n```\n", encoding="utf-8")
    PICTURE.write_text(picture(shown), encoding="utf-8")
    print(f"{CAST.relative_to(ROOT)}: {events[-1][0]:.0f} s, {CAST.stat().st_size} bytes")
    return 0


def write_cast(path: Path, title: str, events: Sequence[tuple[float, str]]) -> None:
    """A file for asciinema."""
    header = {"version": 2, "width": COLUMNS, "height": ROWS, "title": title}
    lines = [json.dumps(header), *(json.dumps([round(t_s, 2), "o", text]) for t_s, text in events)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def film(place: Path, typed: Sequence[str]) -> list[tuple[float, str]]:
    """(time in s, output) of all commands, as a terminal gets it; the clone and all data lie in `place`."""
    (place / ".inputrc").write_text("set enable-bracketed-paste off\n")
    process, fd = pty.fork()
    if process == 0:
        os.chdir(place)
        kept = {name: os.environ[name] for name in ("PATH", "LANG") if name in os.environ}
        path = f"{Path(sys.executable).parent}:{kept.get('PATH', '')}"
        mine = {"HOME": str(place), "ADAPTSIM_HOME": str(place / "data"), "TERM": "xterm-256color", "PS1": PROMPT}
        mine |= {"PATH": path, "PYTHONPATH": str(place / "adaptsim")}  # the program is that of the clone
        mine |= {"GIT_CONFIG_COUNT": "1", "GIT_CONFIG_KEY_0": f"url.{ROOT}.insteadOf", "GIT_CONFIG_VALUE_0": ADDRESS}
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


def screen(stream: str, place: Path) -> str:
    """What a terminal shows of it, with its history and its colours; tmux is that terminal."""
    if shutil.which("tmux") is None:
        raise SystemExit("docs/film.py needs tmux")
    recorded = place / "stream"
    recorded.write_text(stream, encoding="utf-8")
    tmux = ["tmux", "-L", f"film-{os.getpid()}", "-f", "/dev/null"]
    size = ["-x", str(COLUMNS), "-y", str(ROWS)]
    try:
        subprocess.run(
            [*tmux, "start-server", ";", "set", "-g", "history-limit", "20000", ";", "new-session", "-d", *size,
             f"cat {recorded}; sleep 60"], check=True,
        )  # fmt: skip
        time.sleep(3.0)
        shown = subprocess.run(
            [*tmux, "capture-pane", "-e", "-p", "-S", "-"], check=True, capture_output=True, text=True
        )
    finally:
        subprocess.run([*tmux, "kill-server"], check=False)
    return shown.stdout.rstrip().removesuffix("exit").rstrip().removesuffix("$").rstrip()


def plain(shown: str) -> str:
    """Without colours."""
    return "\n".join(line.rstrip() for line in re.sub(r"\x1b\[[0-9;]*m", "", shown).splitlines())


def picture(shown: str) -> str:
    """As SVG that loads nothing from elsewhere."""
    console = Console(record=True, width=COLUMNS, file=io.StringIO(), force_terminal=True)
    console.print(Text.from_ansi(shown))
    svg = console.export_svg(title="adaptsim: a first session")
    return re.sub(r"@font-face \{.*?\}\s*", "", svg, flags=re.DOTALL)


if __name__ == "__main__":
    sys.exit(main())
