"""The operator's guide, command by command in the simulated lab: they work, and print what the guide shows.

A fence below `<!-- run -->` is run, line by line, in the order of the guide and in one home and folder. `exit=3` in the
comment is the exit code that is expected. A fence ```` ```text ```` right after it is what these commands print,
shortened: every line of it must be printed, numbers aside; `…` stands for anything. A fence below
`<!-- file NAME -->` is a file that the reader writes.
"""

from __future__ import annotations

import re
import shlex
import subprocess
import tempfile
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from lab_session import ADAPTSIM, environment

ROOT = Path(__file__).parents[2]
GUIDE, WORLDS = ROOT / "docs/guide/operators-guide.md", ROOT / "sim/worlds/scooping"
FENCE = re.compile(
    r"^(?:<!-- (?P<mark>[^\n]*) -->\n)?```(?P<info>[^\n]*)\n(?P<body>.*?)^```$", re.MULTILINE | re.DOTALL
)
NUMBER = re.compile(r"[-−+]?\d[\d.,]*(?:e[-+]?\d+)?|\bnan\b")
ELLIPSIS = "…"


@dataclass(frozen=True)
class Step:
    """One fence of the guide that can be typed, and the lines that it shows as printed."""

    commands: tuple[str, ...]
    code: int
    shown: tuple[str, ...]


def steps(text: str) -> Iterator[Step]:
    fences = list(FENCE.finditer(text))
    for index, fence in enumerate(fences):
        words = (fence["mark"] or "").split()
        if words[:1] != ["run"]:
            continue
        code = next((int(word.removeprefix("exit=")) for word in words if word.startswith("exit=")), 0)
        commands = tuple(line for line in fence["body"].splitlines() if line.strip())
        yield Step(commands, code, _shown(text, fence, fences[index + 1 : index + 2]))


def _shown(text: str, fence: re.Match[str], after: list[re.Match[str]]) -> tuple[str, ...]:
    """The lines of the output that follows a fence, if nothing but white space lies between."""
    for output in after:
        if output["info"] == "text" and not text[fence.end() : output.start()].strip():
            return tuple(output["body"].splitlines())
    return ()


def files(text: str) -> dict[str, str]:
    """Name -> content of every file that the reader is asked to write."""
    named = (((fence["mark"] or "").split(), fence["body"]) for fence in FENCE.finditer(text))
    return {words[1]: body for words, body in named if len(words) == 2 and words[0] == "file"}


def plain(line: str) -> str:
    """A printed line without what differs from one machine, or one second, to the next."""
    return " ".join(re.sub(r"[↑↓=]", "~", NUMBER.sub("#", line)).split())


def missing(shown: tuple[str, ...], printed: str) -> list[str]:
    """The lines of a guide that were not printed. A sentence may be broken elsewhere: numbers differ in length."""
    lines = [plain(line) for line in printed.splitlines()]
    text = " ".join(line for line in lines if line)
    wanted = [line for line in shown if line.strip(f" {ELLIPSIS}")]
    return [
        line
        for line in wanted
        if not any(pattern(line).fullmatch(found) for found in lines)
        and (ELLIPSIS in line or not re.search(rf"(?<!\S){pattern(line).pattern}(?!\S)", text))
    ]


def pattern(line: str) -> re.Pattern[str]:
    return re.compile(".*".join(re.escape(plain(part)).replace("\\ ", " ") for part in line.split(ELLIPSIS)))


def run(command: str, place: Path) -> subprocess.CompletedProcess[str]:
    home = environment(place / "home", COLUMNS="100", NO_COLOR="1")
    program, *arguments = shlex.split(command, comments=True)
    assert program == "adaptsim"
    line = [*ADAPTSIM, *arguments]
    return subprocess.run(
        line, env=home, cwd=place, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False
    )


@pytest.fixture
def place() -> Iterator[Path]:
    """A folder with a short name: a long one breaks lines elsewhere than in the guide."""
    with tempfile.TemporaryDirectory(prefix="g") as folder:
        yield Path(folder)


@pytest.mark.slow
def test_every_command_of_the_guide_works_and_prints_what_it_shows(place):
    text, done = GUIDE.read_text(encoding="utf-8"), 0
    for name, content in files(text).items():
        (place / name).write_text(content, encoding="utf-8")
    for step in steps(text):
        printed = ""
        for command in step.commands:
            result = run(command, place)
            printed += result.stdout + result.stderr
            assert result.returncode == step.code, f"{command}\n{result.stdout}{result.stderr}"
            assert "Traceback" not in printed, printed
            done += 1
        assert not (gone := missing(step.shown, printed)), f"{step.commands}: not printed: {gone}\n{printed}"
    assert done > 10
    assert (place / "preview.html").stat().st_size > 100_000
    assert (place / "board.pdf").read_bytes().startswith(b"%PDF")
    assert sorted((place / "home/data/sessions").glob("*/report.html"))


def hidden(world: str) -> dict[str, object]:
    """What a world hides, without its camera and its words."""
    return {key: value for key, value in tomllib.loads(world).items() if key not in ("description", "sensing")}


def test_the_guide_has_steps_and_every_one_shows_something_or_says_its_exit_code():
    text = GUIDE.read_text(encoding="utf-8")
    found = list(steps(text))
    assert len(found) > 10
    assert {step.code for step in found} == {0, 3}
    assert sum(bool(step.shown) for step in found) > 8
    assert hidden(files(text)["quick.toml"]) == hidden((WORLDS / "cucumber.toml").read_text())


def test_what_a_guide_shows_is_compared_with_what_was_printed():
    text = "<!-- run exit=3 -->\n```sh\nadaptsim doctor  # why\n```\n\n"
    text += "```text\n✓  disk   75.5 GB …\n…\n```\nsay\n```text\nno\n```\n"
    (step,) = steps(text)
    assert step == Step(("adaptsim doctor  # why",), 3, ("✓  disk   75.5 GB …", "…"))
    assert missing(step.shown, "✓ disk 2 GB free\n") == []
    assert missing(step.shown, "✗ disk 2 GB free\n") == ["✓  disk   75.5 GB …"]
    assert missing(("The camera stands", "at 1.28 m"), "The camera\nstands at -1.28 m\n") == []
    assert missing(("The camera stands", "at 1.28 m"), "The camera\nat 1.28 mm stands\n") == [
        "The camera stands",
        "at 1.28 m",
    ]
