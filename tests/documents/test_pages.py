"""Every page, notebooks too, and `--help` against the program and the repository.

Commands and examples parse and name what exists, links lead somewhere, pictures are there and small, and every page is
on the menu of the site.
"""

from __future__ import annotations

import ast
import os
import re
import shlex
from pathlib import Path

import cv2
import pytest
import session_film
import typer
from documents import FENCE, PAGES, ROOT, commands, every_command, parse, read, shown

from adaptsim_cli import config
from adaptsim_cli.session.running import default_name
from sim.lab.world import list_worlds
from sim.tasks import get_task

DOCS = ROOT / "docs"
GUIDE_PICTURES = sorted((DOCS / "figures").glob("guide-*"))
EXAMPLE = re.compile(r"^Example: (.*)$", re.MULTILINE)
LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)\)")
PACKAGES = ("adaptsim_cli", "benchmarks", "calib", "hw", "perception", "sim", "tests")
PATH = re.compile(rf"`((?:{'|'.join(PACKAGES)}|docs)/[\w./-]+\.(?:py|md|toml|svg|png|ino))`")
MADE_BY_A_READER = {"sim/tasks/curling/__init__.py"}
PLACEHOLDER = re.compile(r"[A-Z]+")
TUTORIAL = "curling"
"""The task that docs/guide/add-a-task.md makes; tests/documents/test_tutorials.py runs its code."""
TARGETS = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
PAGE_WORDS = 725


HELPS = {name: command.help or "" for name, command in every_command()}
EXAMPLES = [line for text in HELPS.values() for line in EXAMPLE.findall(text)]


def world_missing(found: dict[str, object]) -> str:
    """Why the world that these parameters name is none of their task's; empty when it is one, or a file."""
    task, world = str(found.get("task") or "scooping"), str(found.get("world") or "wd")
    if PLACEHOLDER.fullmatch(task) or PLACEHOLDER.fullmatch(world) or "/" in world or world.endswith(".toml"):
        return ""
    if task == TUTORIAL or task.endswith(".py"):  # a file of the reader's own
        return ""
    known = list_worlds(get_task(task))
    return "" if world in known else f"no world {world} of {task}, known: {', '.join(known)}"


def wrong(line: str) -> str:
    """Why this line of a page cannot work; empty if everything that it names exists."""
    program, *words = shlex.split(line, comments=True)
    if program == "adaptsim":
        try:
            missing = world_missing(parse(line))
        except typer.TyperException as error:
            missing = error.format_message()
        return f"{line}: {missing}" if missing else ""
    if program == "make":
        unknown = [word for word in words if "=" not in word and word not in TARGETS]
        return f"{line}: no such target: {', '.join(unknown)}" if unknown else ""
    gone = [word for word in words if re.match(r"(tests|benchmarks|docs)/\S+\.py", word)]
    gone = [word for word in gone if not (ROOT / word.partition("::")[0]).is_file()]
    if gone:
        return f"{line}: no such file: {', '.join(gone)}"
    if program == "python" and words and words[0].startswith("benchmarks/"):
        known = options(ROOT / words[0])
        unknown = [word for word in words if re.match(r"--[a-z]", word) and word.partition("=")[0] not in known]
        return f"{line}: no such option: {', '.join(unknown)}, known: {', '.join(sorted(known))}" if unknown else ""
    return ""


def options(script: Path) -> set[str]:
    """The options that a script adds to its parser, `--help` included."""
    calls = (node for node in ast.walk(ast.parse(script.read_text(encoding="utf-8"))) if isinstance(node, ast.Call))
    added = [call for call in calls if isinstance(call.func, ast.Attribute) and call.func.attr == "add_argument"]
    names = {arg.value for call in added for arg in call.args if isinstance(arg, ast.Constant)}
    return {"--help", *(str(name) for name in names)}


def leads_nowhere(target: str, document: Path) -> str:
    """Why a link of a page is broken; empty if it is not, or leads beyond the repository."""
    if re.match(r"[a-z]+:", target):
        return ""
    name, _, anchor = target.partition("#")
    path = (document.parent / name).resolve() if name else document
    if not path.exists():
        return f"{target}: no such file"
    if anchor and anchor not in anchors(path):
        return f"{target}: no such heading, known: {', '.join(anchors(path))}"
    return ""


def anchors(document: Path) -> list[str]:
    """What the headings of a document are called in links, as GitHub makes it."""
    headings = re.findall(r"^#+ (.*)$", FENCE.sub("", read(document)), re.MULTILINE)
    return [re.sub(r"[^\w\- ]", "", heading.lower()).strip().replace(" ", "-") for heading in headings]


def sessions_of_the_readme(home: Path) -> set[str]:
    """The sessions that its commands begin, on a machine without settings."""
    names = set[str]()
    for line in commands(read(ROOT / "README.md")):
        if not line.startswith("adaptsim run-iteration"):
            continue
        found = parse(line)
        flags = {key: value for key, value in found.items() if key in config.Config.model_fields}
        settings = config.load(flags, {"ADAPTSIM_HOME": str(home)}, home).config
        names.add(str(found.get("session") or default_name(settings)))
    return names


@pytest.mark.parametrize("document", PAGES, ids=shown)
def test_every_command_path_and_link_of_a_page_names_what_exists(document):
    text = read(document)
    lines = [line for program in ("adaptsim", "make", "pytest", "python") for line in commands(text, program)]
    links = LINK.findall(FENCE.sub("", text))
    found = [*map(wrong, lines), *(leads_nowhere(target, document) for target in links)]
    found += [
        f"{name}: no such file" for name in set(PATH.findall(text)) - MADE_BY_A_READER if not (ROOT / name).exists()
    ]
    assert not (said := [why for why in found if why]), "\n".join(said)


@pytest.mark.parametrize("command", HELPS)
def test_every_help_ends_with_one_example_of_its_own_command(command):
    (example,) = EXAMPLE.findall(HELPS[command])
    assert f"{example} ".startswith(f"{command} ")
    assert HELPS[command].rstrip().endswith(example)


@pytest.mark.parametrize("example", EXAMPLES)
def test_every_example_of_help_parses_and_names_what_can_exist(example, tmp_path):
    found = parse(example)
    assert not world_missing(found)
    session = found.get("name" if example.startswith("adaptsim sessions") else "session")
    if session is not None:
        assert session in sessions_of_the_readme(tmp_path)


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("adaptsim calibrate fly", "No such command"),
        ("adaptsim run-iteration --sped 3", "No such option"),
        ("adaptsim run-iteration -n 0", "greater than or equal to 1|not in the range x>=1"),
        ("adaptsim --sped", "No such option"),
        ("adaptsim sessions redo NAME first", "valid int"),
        ("adaptsim retrack --json", "Missing argument"),
        ("adaptsim rollout --world narnia", "no world narnia of scooping"),
        ("make tea", "no such target: tea"),
        ("pytest -q tests/nowhere.py", "no such file: tests/nowhere.py"),
        ("python benchmarks/nothing.py", "no such file"),
        ("python benchmarks/stopping.py --scops 3", "no such option: --scops"),
    ],
)
def test_a_wrong_line_is_noticed(line, why):
    (found,) = commands(f"see\n```sh\n{line}   # says the comment\n```\n", line.split(maxsplit=1)[0])
    assert re.search(why, wrong(found))


def test_commands_are_found_in_fences_indented_and_in_prose():
    text = "`adaptsim\ndoctor`, not\nadaptsim at large.\n\n    adaptsim lab list\n\n"
    text += "```sh\nA=1 adaptsim report X # y\n```\n"
    assert commands(text) == ["adaptsim report X # y", "adaptsim lab list", "adaptsim doctor"]
    assert parse("adaptsim report X # y")["session"] == "X"
    for line in ("make TORCH_INDEX=x setup", "pytest -m slow tests/e2e/test_operators_guide.py", "python -m venv x"):
        assert wrong(line) == ""


@pytest.mark.parametrize("picture", GUIDE_PICTURES, ids=shown)
def test_pictures_of_the_guide_are_small_and_shown(picture):
    image = cv2.imread(str(picture))
    assert image.shape[1] <= 1200
    assert picture.stat().st_size < 300_000
    assert f"figures/{picture.name})" in (DOCS / "guide/operators-guide.md").read_text(encoding="utf-8")


def test_the_film_of_a_session_is_small_and_shown():
    for path, most in session_film.MOST_BYTES.items():
        assert 10_000 < path.stat().st_size <= most
    film = cv2.VideoCapture(str(session_film.FILM))
    assert 60.0 <= film.get(cv2.CAP_PROP_FRAME_COUNT) / film.get(cv2.CAP_PROP_FPS) <= 90.0
    shown_in = {DOCS / "README.md": session_film.FILM, DOCS / "guide/operators-guide.md": session_film.POSTER}
    for page, path in {**shown_in, ROOT / "README.md": session_film.SHORT}.items():
        assert f"figures/{path.name}" in read(page)


def test_every_document_that_the_code_names_exists():
    gone = []
    for path in (path for folder in PACKAGES for path in (ROOT / folder).rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        gone += [f"{path.name}: {n}" for n in re.findall(r"docs/[\w/-]+\.md", text) if not (ROOT / n).is_file()]
        decisions = re.findall(r"docs/decisions/(\d{4})", text)
        gone += [f"{path.name}: {n}" for n in decisions if not [*DOCS.glob(f"decisions/{n}-*.md")]]
    assert not gone, gone


def test_every_page_is_on_the_menu_of_the_site_and_linked_from_an_index():
    pages = {str(page.relative_to(DOCS)) for page in PAGES if DOCS in page.parents and page.suffix == ".md"}
    menu = re.findall(r"- (?:\w+: )?(\S+\.md)$", (ROOT / "mkdocs.yml").read_text(encoding="utf-8"), re.MULTILINE)
    assert sorted(menu) == sorted(page for page in pages if not page.startswith("decisions/0"))
    linked = {"README.md"}
    for index in (DOCS / "README.md", DOCS / "decisions/README.md", DOCS / "results.md"):
        for target in re.findall(r"\]\(([^)#\s]+\.md)", index.read_text(encoding="utf-8")):
            linked.add(os.path.relpath(index.parent / target, DOCS))
    assert not pages - linked


def test_a_decision_fits_on_a_page():
    lengths = {page.name: len(page.read_text(encoding="utf-8").split()) for page in (DOCS / "decisions").glob("0*.md")}
    assert len(lengths) > 10
    assert not {name: words for name, words in lengths.items() if words > PAGE_WORDS}
