"""Every call that a page or `--help` shows is executed in one home of the simulated lab, and ends as it should.

Lines that take hours, or need what a test has not, are in `ELSEWHERE` with the reason. The operator's guide has a test
of its own. A line that only names a command (`adaptsim report`) is checked by tests/documents/test_pages.py.
A call of a real arm is executed too: without one it is refused.
"""

from __future__ import annotations

import re
import shlex
import subprocess
import tempfile
from importlib.util import find_spec
from pathlib import Path

import pytest
import real_views
import typer
from documents import PAGES, ROOT, commands, every_command, read
from lab_session import ADAPTSIM, environment

COMMANDS = dict(every_command())
SESSION = "scooping-oreo"
OTHER = "scooping-ood-1-udr"
STANDS_FOR = {"SESSION": SESSION, "A": SESSION, "B": OTHER, "FIRST": "1", "SECOND": "2", "TEXT": "text"}
STANDS_FOR |= {"VIEWS": "my-views", "COMMAND": "run-iteration"}
ELSEWHERE = {
    r" pretrain": "minutes to an hour; tests/adaptsim_cli/commands runs it with few rollouts",
    r" world-tables": "minutes of two cores; tests/adaptsim_cli/commands runs it with few rollouts",
    r" benchmark (--task (pushing|scooping)|--fresh)": "needs the tables of forty worlds",
    r" curling": "the task of a tutorial; tests/documents/test_tutorials.py",
    r"adaptsim object |--object tofu.toml": "minutes of two cores; tests/adaptsim_cli/commands, with a pendulum",
    r" --rerun": "opens a viewer; tests/extras",
    r" --recorded my-pushes": "needs bags of ROS 2; tests/documents runs the page's own commands",
    r" overlay": "needs pictures; tests/adaptsim_cli/bench/calibration/test_arm_picture.py",
    r" amend \S+ \d+$": "asks at the terminal; tests/adaptsim_cli/session/test_amending.py",
}
"""What is not executed here -> why."""
PRELUDE = (
    f"adaptsim run-iteration --task scooping --world ood-1 --method udr --session {OTHER} --yes",
    "adaptsim rollout --task pendulum --yes",
    "adaptsim run-iteration --task pendulum --world ood-1 --session first --yes",
    "adaptsim calibrate --hw fake --world ood-1 --seed 0 --yes",
)
"""Makes what the lines take for granted."""
FIRST = (r" run-iteration", r" calibrate --hw fake", r" calibrate restore", r" touch-off --task", r" rollout ")
LAST = (
    r" redo",
    r" accept",
    r" amend",
    r" prune",
    r" mark",
    r" --own-cal",
    r" init",
    r" delete",
)
"""Lines come in this order, all others between the two."""
NEEDS_EXTRA = {"--format lerobot": "pyarrow", "--format parquet": "pyarrow", "--format rerun": "rerun"}
REFUSED = {2, 3}
LENS_IN_DOUBT = r" solve my-views"
"""Twenty real views: the camera states no distortion, the views ask for one, and the error is too large."""


def documented() -> list[str]:
    """The calls of all pages and examples, with placeholders filled in, in an order in which they can be executed."""
    left_out = {ROOT / "docs/guide/operators-guide.md", ROOT / "docs/reference/commands.md"}
    shown = [line for page in PAGES if page not in left_out for line in commands(read(page))]
    examples = re.findall(
        r"^Example: (.*)$", "\n".join(command.help or "" for command in COMMANDS.values()), re.MULTILINE
    )
    calls = [words for line in shown if _says_more(words := shlex.split(line, comments=True))]
    calls += [shlex.split(line) for line in examples]
    return sorted({shlex.join(_filled(words)) for words in calls}, key=lambda line: (_place(line), line))


def _place(line: str) -> int:
    found = [i for i, pattern in enumerate((*FIRST, r"", *LAST)) if pattern and re.search(pattern, line)]
    return max(found, default=len(FIRST))


def _filled(words: list[str]) -> list[str]:
    """The line with a value for every placeholder."""
    trial = "2" if "--json" in words else "1"  # a trial is redone once
    names = iter(("1",) if words[1] in {"calibrate", "touch-off"} else (SESSION, OTHER))
    values = STANDS_FOR | {"TRIAL": trial}
    return [next(names) if word == "NAME" else values.get(word, word) for word in words]


def _called(words: list[str]) -> tuple[typer.core.TyperCommand | None, list[str]]:
    """The command of a line and what follows it; None where it names none."""
    for length in (3, 2):
        if command := COMMANDS.get(" ".join(words[:length])):
            return command, words[length:]
    return None, words[1:]


def _says_more(words: list[str]) -> bool:
    """Whether a line says more than which command it means, and that its output be JSON."""
    command, rest = _called(words)
    return command is not None and bool(set(rest) - {"--json"})


def elsewhere(line: str) -> str:
    """Why this line is not executed here; empty if it is."""
    return next((why for pattern, why in ELSEWHERE.items() if re.search(pattern, line)), "")


def run(line: str, place: Path) -> str:
    """Execute a line without a terminal; returns what was wrong, empty if it ended as it should."""
    words = shlex.split(line)
    has = {parameter.name for parameter in _called(words)[0].params}
    real = "fr3" in words or "panda" in words
    if "yes" in has and "--yes" not in words and not real:
        words.append("--yes")  # there is nobody to ask
    if "html" in has and "--html" not in words:
        words += ["--html", "page.html"]  # instead of a server
    lab = environment(place / "home", ADAPTSIM_WORLD="ood-1", COLUMNS="100")
    done = subprocess.run(
        [*ADAPTSIM, *words[1:]], env=lab, cwd=place, stdin=subprocess.DEVNULL, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    extra = next((package for option, package in NEEDS_EXTRA.items() if option in line), "sys")
    right = REFUSED | {0} if real else {0} if find_spec(extra) else REFUSED
    right = {3} if re.search(LENS_IN_DOUBT, line) else right
    if done.returncode in right and "Traceback" not in done.stderr:
        return ""
    return f"{line}: exit code {done.returncode}\n{done.stdout[-1500:]}{done.stderr[-1500:]}"


def views(place: Path) -> None:
    """The folders that the pages call my-views and camera-0 to camera-2."""
    real_views.corner_folder(place / "my-views")
    for number in range(3):
        real_views.corner_folder(place / f"camera-{number}", number)


@pytest.mark.slow
@pytest.mark.timeout(4 * 3600)
def test_every_documented_call_works():
    with tempfile.TemporaryDirectory(prefix="c") as folder:
        place = Path(folder)
        views(place)
        lines = [*PRELUDE, *(line for line in documented() if not elsewhere(line))]
        assert len(lines) > 60
        assert not (wrong := [why for line in lines if (why := run(line, place))]), "\n\n".join(wrong)


def test_whatever_is_not_executed_is_documented_and_has_a_reason():
    lines = documented()
    for pattern in ELSEWHERE:
        assert any(re.search(pattern, line) for line in lines), pattern
    assert sum(not elsewhere(line) for line in lines) > 60
    assert not [line for line in lines if {"NAME", "TRIAL", *STANDS_FOR} & set(shlex.split(line))]


def test_a_session_is_begun_before_it_is_read_and_deleted_last():
    lines = [line for line in documented() if not elsewhere(line)]
    begun = lines.index("adaptsim run-iteration --task scooping --world oreo --seed 0 --yes")
    reading = [i for i, line in enumerate(lines) if SESSION in line and "run-iteration" not in line]
    assert begun < min(reading)
    assert lines.index(f"adaptsim sessions redo {SESSION} 1") < lines.index(f"adaptsim sessions accept {SESSION} 1")
    assert lines[-1] == f"adaptsim sessions delete {SESSION}"
