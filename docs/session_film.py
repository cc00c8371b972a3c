"""Film a session: the terminal and the live page side by side, then the report.

    python docs/session_film.py FOLDER

The session really runs in the simulated lab, with all data in FOLDER (some minutes). If FOLDER has a complete record,
only the film is made again. A step that takes longer than `STEP_S` is played faster; nothing else is changed. Written
are docs/figures/session.webm, its poster, and the short film of README.md. Needs tmux, ffmpeg, and Chromium or Chrome.
"""

from __future__ import annotations

import argparse
import base64
import io
import json
import os
import re
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from itertools import groupby
from pathlib import Path

import numpy as np
from check_live import Tab, tab, until
from PIL import Image
from rich.console import Console
from rich.text import Text

FIGURES = Path(__file__).parent / "figures"
FILM, POSTER, SHORT = FIGURES / "session.webm", FIGURES / "session-poster.webp", FIGURES / "session.webp"
MOST_BYTES = {FILM: 4_000_000, POSTER: 100_000, SHORT: 300_000}

COMMAND = "ADAPTSIM_PARTICLES=1 adaptsim run-iteration --task scooping --world oreo --yes --view -n 2"
"""Two iterations of two trials."""
COLUMNS, ROWS = 80, 38
WIDTH_PX, HEIGHT_PX, TERMINAL_PX = 1280, 720, 592
"""Size of the film, and the width of its left part."""
PAGE_PX = 1000
"""Width in which live page and report are laid out, before they are scaled to the right part."""
SCALE = (WIDTH_PX - TERMINAL_PX) / PAGE_PX

STEP_S, REST_S, RATE_HZ = 1.0, 2.5, 10
"""Longest time of a step in the film, time of the last picture of the session, and pictures per second."""
LOOKS = 12
"""The longer a step has lasted, the rarer it is looked at: after a part of its time so far, one in this many."""
TYPED = 3
"""Letters of the command in one picture of the film."""
STOPS, STOP_S = 12, 1.7
"""Number of stops at which the report is shown, and the time of each."""
SHORT_PX, SHORT_PICTURES, SHORT_S = 640, 16, 1.0
"""Width of the film in README.md, number of its pictures, and the time of each."""

STEP = re.compile(r"(?:[⠀-⣿] )?(\S.*?)[:\s]+\d+ s")
"""A line of a step, with the seconds so far."""
ADDRESS = re.compile(r"Live page: (http\S+)")
FOLLOW = "window.scrollTo({top: state.judged ? 1e5 : 0, behavior: 'smooth'})"
"""The live page is scrolled down once a trial is tracked, as its reader would do."""
TERMINAL = f"""<meta charset="utf-8"><style>
body {{ margin: 0; background: #14181d; overflow: hidden }}
pre {{ margin: 0; padding: 10px 8px; font: 12px/17px "DejaVu Sans Mono", monospace; color: #e4e2dc; height: 664px }}
p {{ margin: 0; padding: 9px 10px; font: 13px/18px "DejaVu Sans", sans-serif; color: #14181d; background: #1fa3b8 }}
</style><pre></pre><p>Simulated lab: no real robot moves. Steps over {STEP_S:g} s are played faster.</p>"""


@dataclass(frozen=True)
class Moment:
    """One look at terminal and page. `terminal` has its colours; it is empty while the report is shown."""

    t_s: float
    terminal: str
    page: str  # name of the picture


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="folder for the session and its pictures")
    folder = parser.parse_args().folder.absolute()
    record = folder / "moments.json"
    if not record.is_file():
        (folder / "home").mkdir(parents=True)
        with shell(folder / "home") as terminal, tab(folder) as page:
            moments = [*session(terminal, page, folder), *report(page, folder)]
        record.write_text(json.dumps([asdict(moment) for moment in moments]), encoding="utf-8")
    moments = [Moment(**one) for one in json.loads(record.read_text(encoding="utf-8"))]
    for moment in moments:
        assert str(folder) not in "".join(lines(moment.terminal)), "the terminal shows a path of this computer"
    shown = timeline(moments)
    needed = sorted(set(shown))
    with tab(folder) as page:
        left = terminals(page, [moments[i] for i in needed])
        drawn = {i: side_by_side(one, folder / moments[i].page) for i, one in zip(needed, left, strict=True)}
    pictures = [drawn[i] for i in shown]
    write_film(pictures)
    write_stills(pictures)
    for path, most in MOST_BYTES.items():
        size = path.stat().st_size
        assert size <= most, f"{path.name} has {size} bytes, at most {most} are allowed"
        print(f"Written: {path}, {size / 1e3:.0f} kB")
    print(f"The film has {len(shown) / RATE_HZ:.0f} s")


class Shell:
    """A shell in a terminal of `COLUMNS` x `ROWS`."""

    def __init__(self, home: Path) -> None:
        self._home, self._tmux = str(home), ("tmux", "-L", f"film-{os.getpid()}", "-f", "/dev/null")
        path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
        bash = ("env", f"HOME={home}", f"PATH={path}", "PS1=$ ", "bash", "--norc", "--noprofile")
        self.call("new-session", "-d", "-x", str(COLUMNS), "-y", str(ROWS), "-c", str(home), *bash)

    def call(self, *words: str) -> str:
        """The output of a command of tmux."""
        return subprocess.run([*self._tmux, *words], check=True, capture_output=True, text=True).stdout

    def screen(self) -> str:
        """The terminal with its colours, without the name of the home folder."""
        return self.call("capture-pane", "-e", "-p").replace(self._home, "~")

    def is_ready(self) -> bool:
        """Whether the shell waits for a command."""
        return lines(self.screen())[-1] == "$"


@contextmanager
def shell(home: Path) -> Iterator[Shell]:
    terminal = Shell(home)
    try:
        yield terminal
    finally:
        terminal.call("kill-server")


def session(terminal: Shell, page: Tab, folder: Path) -> Iterator[Moment]:
    """Type the command and look at terminal and page, until the shell waits again."""
    size_page(page)
    until(terminal.is_ready, "the shell did not start")
    blank = photo(page, folder)
    for i in range(0, len(COMMAND), TYPED):
        terminal.call("send-keys", "-l", "--", COMMAND[i : i + TYPED])
        time.sleep(0.1)
        yield Moment(i / TYPED / RATE_HZ, terminal.screen(), blank)
    began_s = time.monotonic() - len(COMMAND) / TYPED / RATE_HZ
    terminal.call("send-keys", "Enter")
    until(lambda: ADDRESS.search(terminal.screen()) is not None, "the page was not served")
    page.open(ADDRESS.findall(terminal.screen())[0])
    size_page(page)
    step, since_s = "", time.monotonic()
    while not terminal.is_ready():
        page.script(FOLLOW)
        yield Moment(time.monotonic() - began_s, terminal.screen(), photo(page, folder))
        if (now := step_of(terminal.screen())) != step:
            step, since_s = now, time.monotonic()
        time.sleep((time.monotonic() - since_s) / LOOKS)
    yield Moment(time.monotonic() - began_s, terminal.screen(), photo(page, folder))


def report(page: Tab, folder: Path) -> Iterator[Moment]:
    """Scroll through the session's report, stop by stop."""
    (path,) = (folder / "home").rglob("report.html")
    page.open(path.as_uri())
    last = int(page.script("document.documentElement.scrollHeight - innerHeight"))
    for i, top in enumerate(np.linspace(0, last, STOPS)):
        page.script(f"window.scrollTo(0, {top:.0f})")
        yield Moment(i * STOP_S, "", photo(page, folder))


def size_page(page: Tab) -> None:
    """Lay the page out for the right part of the film."""
    height = round(HEIGHT_PX / SCALE)
    page.ask("Emulation.setDeviceMetricsOverride", width=PAGE_PX, height=height, deviceScaleFactor=SCALE, mobile=False)


def photo(page: Tab, folder: Path) -> str:
    """The name of a picture of the page as it is now."""
    name = f"{time.time_ns()}.png"
    (folder / name).write_bytes(picture(page))
    is_private = page.script(f"document.body.innerText.includes({json.dumps(str(folder))})")
    assert not is_private, "the page shows a path of this computer"
    return name


def picture(page: Tab) -> bytes:
    """The page as PNG."""
    return base64.b64decode(page.ask("Page.captureScreenshot", format="png")["data"])


def terminals(page: Tab, moments: Sequence[Moment]) -> Iterator[Image.Image]:
    """The left part at every moment; beside the report, the terminal stays as it was."""
    page.ask(
        "Emulation.setDeviceMetricsOverride", width=TERMINAL_PX, height=HEIGHT_PX, deviceScaleFactor=1, mobile=False
    )
    page.open("data:text/html;base64," + base64.b64encode(TERMINAL.encode()).decode())
    terminal, drawn = "", Image.new("RGB", (TERMINAL_PX, HEIGHT_PX))
    for moment in moments:
        if moment.terminal not in ("", terminal):
            terminal = moment.terminal
            page.script(f"document.querySelector('pre').innerHTML = {json.dumps(as_html(terminal))}")
            drawn = Image.open(io.BytesIO(picture(page))).convert("RGB")
        yield drawn


def as_html(terminal: str) -> str:
    """Text with terminal colours as HTML."""
    console = Console(file=io.StringIO(), record=True, width=COLUMNS, force_terminal=True)
    console.print(Text.from_ansi(terminal), soft_wrap=True)
    html = console.export_html(inline_styles=True, code_format="{code}")
    return html.replace("color: #000000", "").replace("background-color: #ffffff", "")  # those of the page


def side_by_side(left: Image.Image, right: Path) -> Image.Image:
    """Terminal and page in one picture of the film."""
    both = Image.new("RGB", (WIDTH_PX, HEIGHT_PX), "white")
    both.paste(left, (0, 0))
    both.paste(Image.open(right).convert("RGB").resize((WIDTH_PX - TERMINAL_PX, HEIGHT_PX)), (TERMINAL_PX, 0))
    return both


def lines(terminal: str) -> list[str]:
    """The lines of a terminal without colours, down to the last one with text."""
    return [line.strip() for line in Text.from_ansi(terminal).plain.rstrip().splitlines()] or [""]


def step_of(terminal: str) -> str:
    """The step that runs now, without its seconds; the last line if there is no step."""
    line = lines(terminal)[-1]
    step = STEP.fullmatch(line)
    return step[1] if step else line


def timeline(moments: Sequence[Moment]) -> list[int]:
    """The number of the moment that each picture of the film shows."""
    live = [i for i, moment in enumerate(moments) if moment.terminal]
    shown = list[int]()
    for _, group in groupby(live, key=lambda i: step_of(moments[i].terminal)):
        step = list(group)
        at_s = np.array([moments[i].t_s for i in step]) - moments[step[0]].t_s
        lasts_s = moments[min(step[-1] + 1, live[-1])].t_s - moments[step[0]].t_s
        count = max(1, round(min(lasts_s, STEP_S) * RATE_HZ))
        times_s = np.arange(count) / count * lasts_s
        shown += [step[i] for i in np.searchsorted(at_s, times_s, side="right") - 1]
    stops = np.repeat(np.arange(live[-1] + 1, len(moments)), round(STOP_S * RATE_HZ))
    return [*shown, *[live[-1]] * round(REST_S * RATE_HZ), *stops.tolist()]


def write_film(pictures: Sequence[Image.Image]) -> None:
    """VP9 at `RATE_HZ`."""
    source = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{WIDTH_PX}x{HEIGHT_PX}", "-r", str(RATE_HZ), "-i", "-"]
    coding = ["-c:v", "libvpx-vp9", "-pix_fmt", "yuv420p", "-b:v", "0", "-crf", "42", "-deadline", "realtime"]
    command = ["ffmpeg", "-y", "-loglevel", "error", *source, *coding, "-cpu-used", "7", "-g", "200", str(FILM)]
    with subprocess.Popen(command, stdin=subprocess.PIPE) as ffmpeg:
        assert ffmpeg.stdin is not None
        for one in pictures:
            ffmpeg.stdin.write(one.tobytes())
    assert ffmpeg.returncode == 0, "ffmpeg did not write the film"


def write_stills(pictures: Sequence[Image.Image]) -> None:
    """The poster, and the short film of README.md."""
    pictures[len(pictures) // 2].save(POSTER, quality=80)
    small = SHORT_PX, SHORT_PX * HEIGHT_PX // WIDTH_PX
    chosen = np.linspace(0, len(pictures) - 1, SHORT_PICTURES).round().astype(int)
    first, *others = [pictures[i].resize(small, Image.Resampling.LANCZOS) for i in chosen]
    options = {"save_all": True, "append_images": others, "duration": int(1e3 * SHORT_S), "loop": 0, "method": 4}
    for quality in (45, 30, 20):
        first.save(SHORT, quality=quality, **options)
        if SHORT.stat().st_size <= MOST_BYTES[SHORT]:
            break


if __name__ == "__main__":
    main()
