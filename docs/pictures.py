"""Make the pictures of the guide again, from the program as it is.

    python docs/pictures.py            a few minutes; needs Chromium or Chrome
    python docs/pictures.py session    only the pictures of that part
    python docs/pictures.py --check    exit code 1 if a screen that a picture shows has changed since

A session runs in the simulated lab with its page open: camera, live page, report with numbers, film of a scoop. The
first trial of another is answered in a terminal (tmux). The planned motion is played from the page of `adaptsim
preview`; a calibration holds the board. A digest of the files that draw each picture is written to
docs/figures/pictures.json; a test compares it.
"""

from __future__ import annotations

import argparse
import base64
import hashlib
import io
import json
import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
from PIL import Image

if TYPE_CHECKING:
    from check_live import Tab

ROOT = Path(__file__).parents[1]
FIGURES, STATES = ROOT / "docs/figures", ROOT / "docs/figures/pictures.json"
WORLD = ("--task", "scooping", "--world", "cucumber", "--seed", "0")

DRAWN_BY: Mapping[str, Sequence[str]] = {
    "guide-camera-view.webp": ("sim/worlds/scooping/cucumber.toml", "sim/render/renderer.py", "sim/lab/kinect.py"),
    "guide-preview.webp": ("sim/lab/preview.py", "adaptsim_cli/bench/preview.html.j2"),
    "guide-report.webp": ("adaptsim_cli/show/page.html.j2", "adaptsim_cli/screen/style.css"),
    "live-page.webp": ("adaptsim_cli/show/live.html",),
    "guide-trial.webp": (
        "adaptsim_cli/session/operator.py",
        "adaptsim_cli/session/terminal_views.py",
        "adaptsim_cli/bench/devices/consent.py",
    ),
    "scoop.webp": ("sim/render/renderer.py", "sim/lab/kinect.py"),
    "board-in-hand.jpg": ("sim/render/renderer.py", "sim/lab/board.py"),
}
"""Each picture, and the files that draw what it shows."""


NUMBERED = """
[".gain", ".figures div:nth-child(1) dt", ".verdict", ".best", ".best ~ .best", "section figure"]
  .forEach((selector, i) => {
    const mark = document.createElement("span");
    mark.textContent = i + 1;
    mark.style = "display:inline-block;width:1.5em;line-height:1.5em;margin-right:.5em;border-radius:50%;text-align:center;"
      + "font:bold 13px/1.5 sans-serif;background:#b34700;color:white";
    document.querySelector(selector).prepend(mark);
  });
"""
"""Numbers in the report, which the operator's guide explains."""


PARTS = ("SIMULATED", "The simulated lab puts", "Found", "Action", "Predicted reward", "The motion takes", "Detection",
         "The simulated robot is about", "Is the work area clear", "Tracked")  # fmt: skip
"""The first words of the numbered lines of a trial; the operator's guide explains the numbers."""
ANSWERS = (("stop, ? explains", ""), ("Type panda", "panda"), ("comes to the piece", "y"), ("makes its motion", "y"),
           ("goes back", "y"), ("Is this what you saw", ""))  # fmt: skip
"""The questions of the first trial, and the typed answers."""
TRIAL_PAGE = """<meta charset="utf-8"><style>
body {{ margin: 0; background: white }}
pre {{ margin: 0; padding: 14px 14px 14px 52px; font: 14px/1.5 "DejaVu Sans Mono", monospace; color: #222 }}
b.mark {{ position: absolute; left: 14px; width: 1.5em; border-radius: 50%; text-align: center;
          font: bold 13px/1.5 sans-serif; background: #b34700; color: white }}
</style><pre>{code}</pre>"""


QUALITY = 82
"""Quality of a WebP picture: text stays sharp, and a small piece keeps its colour."""


def digests() -> dict[str, str]:
    """The digest of each picture's files."""
    return {
        name: hashlib.sha256(b"".join((ROOT / file).read_bytes() for file in files)).hexdigest()[:16]
        for name, files in DRAWN_BY.items()
    }


def outdated() -> list[str]:
    """The pictures whose screens have changed since they were made."""
    made = json.loads(STATES.read_text(encoding="utf-8")) if STATES.is_file() else {}
    return [name for name, digest in digests().items() if made.get(name) != digest]


def shoot(page: Tab, name: str, width: int, height: int) -> None:
    """The page as it is laid out now."""
    page.ask("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
    time.sleep(1.0)
    shot = page.ask("Page.captureScreenshot", format="png")
    Image.open(io.BytesIO(base64.b64decode(shot["data"]))).convert("RGB").save(FIGURES / name, quality=QUALITY)


def session(page: Tab, _: Path) -> None:
    """A session to its verdict: the live page when a trial of the second iteration is tracked, then the report."""
    from check_live import live_session  # noqa: PLC0415 needs a package that the check does not

    shown = "state.judged && state.trial.iteration === 2"
    with live_session(page, shown, *WORLD, "--session", "guide", "-n", "5", "--until-done"):
        shoot(page, "live-page.webp", 1120, 1560)
    folder = Path(os.environ["ADAPTSIM_HOME"]) / "data/sessions/guide"
    page.open((folder / "report.html").as_uri())
    page.script(NUMBERED)
    shoot(page, "guide-report.webp", 970, 980)
    film(sorted(folder.glob("iteration-*/trial-*/recording.mcap"))[-1])


def film(recording: Path) -> None:
    """A scoop of the adapted policy, every second picture, in a loop."""
    from adaptsim_cli import api  # noqa: PLC0415 imports OpenCV's readers

    frames = [
        Image.fromarray(cv2.resize(frame.colour[:, 320:960], (480, 540), interpolation=cv2.INTER_AREA))
        for frame in api.read_recording(recording).frames[::2]
    ]
    first, *others = frames
    first.save(FIGURES / "scoop.webp", save_all=True, append_images=others, duration=67, loop=0, quality=55)


def trial(page: Tab, folder: Path) -> None:
    """The first trial of a session in a terminal of 96 columns, until the question about its outcome."""
    tmux = ["tmux", "-L", f"pictures-{os.getpid()}", "-f", "/dev/null"]
    command = f"{sys.executable} -m adaptsim_cli run-iteration {' '.join(WORLD)} --session trial"
    subprocess.run([*tmux, "new-session", "-d", "-x", "96", "-y", "70", command], check=True)
    try:
        for question, answer in ANSWERS:
            shown = _terminal(tmux, question)
            if question != ANSWERS[-1][0]:
                subprocess.run([*tmux, "send-keys", answer, "Enter"], check=True)
    finally:
        subprocess.run([*tmux, "kill-server"], check=False)
    lines = shown.replace(str(folder), "~").splitlines()
    first = next(i for i, line in enumerate(lines) if "Trial 1" in plain(line))
    html = folder / "trial.html"
    html.write_text(TRIAL_PAGE.format(code=_numbered(lines[first:])), encoding="utf-8")
    page.open(html.as_uri())
    shoot(page, "guide-trial.webp", 900, 28 + 21 * len(lines[first:]))


def plain(shown: str) -> str:
    """Without colours and links."""
    bare = re.sub(r"\x1b\[[0-9;]*m|\x1b\]8;[^\x1b\x07]*(?:\x1b\\|\x07)", "", shown)
    return "\n".join(line.rstrip() for line in bare.splitlines())


def _terminal(tmux: Sequence[str], question: str) -> str:
    """The screen with its colours, once it ends with a question that has these words. Raises TimeoutError."""
    for _ in range(300):
        time.sleep(1.0)
        capture = [*tmux, "capture-pane", "-e", "-p", "-J"]
        shown = subprocess.run(capture, check=True, capture_output=True, text=True).stdout.rstrip()
        asked = " ".join(plain(shown).split())
        if asked.endswith(":") and question in asked[-300:]:
            return shown
    raise TimeoutError(f"no question {question!r}")


def _numbered(lines: Sequence[str]) -> str:
    """Lines with colours as HTML, with a number before each of `PARTS`."""
    from rich.console import Console  # noqa: PLC0415
    from rich.text import Text  # noqa: PLC0415

    left, rows = list(PARTS), []
    for line in Text.from_ansi("\n".join(lines)).split("\n", allow_blank=True):
        console = Console(file=io.StringIO(), record=True, width=100, force_terminal=True)
        console.print(line, soft_wrap=True)
        code = console.export_html(inline_styles=True, code_format="{code}").rstrip()
        if left and line.plain.strip().startswith(left[0]):
            code = f'<b class="mark">{len(PARTS) - len(left) + 1}</b>{code}'
            del left[0]
        rows.append(code)
    assert not left, f"the trial shows no line {left[0]!r}"
    return "\n".join(rows)


def board(_: Tab, __: Path) -> None:
    """The calibration board in the hand, as the camera sees it, with the corners that were found."""
    from check_live import adaptsim  # noqa: PLC0415

    subprocess.run(adaptsim("calibrate", *WORLD, "--yes"), check=True, capture_output=True)
    view = sorted(Path(os.environ["ADAPTSIM_HOME"]).glob("data/calibrations/*/views-0001/004.corners.jpg"))[0]
    picture = cv2.imread(str(view))
    assert picture is not None, "the calibration keeps its pictures"
    small = cv2.resize(picture, (720, 405), interpolation=cv2.INTER_AREA)
    cv2.imwrite(str(FIGURES / "board-in-hand.jpg"), small, [cv2.IMWRITE_JPEG_QUALITY, 80])


def preview(page: Tab, folder: Path) -> None:
    """The planned motion, half way."""
    from check_live import adaptsim  # noqa: PLC0415

    html = folder / "preview.html"
    subprocess.run(adaptsim("preview", "--task", "scooping", "--html", str(html)), check=True, capture_output=True)
    page.open(html.as_uri())
    time.sleep(6.0)  # the scene is drawn, and the motion plays
    shoot(page, "guide-preview.webp", 900, 600)


def camera(_: Tab, folder: Path) -> None:
    """The camera's picture of the table."""
    from check_live import adaptsim  # noqa: PLC0415

    whole = folder / "camera.png"
    subprocess.run(adaptsim("lab", "show", *WORLD, "--png", str(whole)), check=True, capture_output=True)
    picture = cv2.imread(str(whole))
    assert picture is not None, "the lab wrote its picture"
    small = cv2.resize(picture, (720, 405), interpolation=cv2.INTER_AREA)
    Image.fromarray(small[..., ::-1]).save(FIGURES / "guide-camera-view.webp", quality=QUALITY)


PARTS_OF: Mapping[str, tuple[Callable[[Tab, Path], None], Sequence[str]]] = {
    "camera": (camera, ("guide-camera-view.webp",)),
    "preview": (preview, ("guide-preview.webp",)),
    "session": (session, ("live-page.webp", "guide-report.webp", "scoop.webp")),
    "trial": (trial, ("guide-trial.webp",)),
    "board": (board, ("board-in-hand.jpg",)),  # last: its calibration would be used by a session
}
"""Each part, in order: what makes it, and its pictures."""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true")
    parser.add_argument("parts", nargs="*", metavar="part", help=f"one of {', '.join(PARTS_OF)}; default: all")
    asked = parser.parse_args()
    parts = asked.parts or list(PARTS_OF)
    if unknown := set(parts) - set(PARTS_OF):
        parser.error(f"no part {', '.join(sorted(unknown))}: choose of {', '.join(PARTS_OF)}")
    if asked.check:
        print("\n".join(outdated()) or "every picture shows the program as it is")
        return 1 if outdated() else 0
    from check_live import tab  # noqa: PLC0415

    with tempfile.TemporaryDirectory() as home, tab(Path(home)) as page:
        os.environ["ADAPTSIM_HOME"] = home
        for part, (make, _) in PARTS_OF.items():
            if part in parts:
                make(page, Path(home))
    drawn = [name for part in parts for name in PARTS_OF[part][1]]
    before = json.loads(STATES.read_text(encoding="utf-8")) if STATES.is_file() else {}
    now = {name: digest for name, digest in digests().items() if name in drawn}
    STATES.write_text(json.dumps({name: (before | now)[name] for name in DRAWN_BY}, indent=1) + "\n", encoding="utf-8")
    print("\n".join(f"docs/figures/{name}" for name in drawn))
    return 0


if __name__ == "__main__":
    sys.exit(main())
