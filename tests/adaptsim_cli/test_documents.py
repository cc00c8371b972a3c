"""Every page, notebooks too, and `--help` against the program.

Commands and examples parse and name what exists, links lead somewhere, pictures are there and small.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import cv2
import pytest
import typer
from documents import FENCE, PAGES, ROOT, commands, read, shown

from adaptsim_cli import app, config
from adaptsim_cli.session.running import default_name
from sim.lab.world import list_worlds
from sim.tasks import get_task

PROGRAM: typer.core.TyperGroup = typer.main.get_command(app.app)  # type: ignore[assignment]
GUIDE_PICTURES = sorted((ROOT / "docs/figures").glob("guide-*"))
EXAMPLE = re.compile(r"^Example: (.*)$", re.MULTILINE)
LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)\)")
PLACEHOLDER = re.compile(r"[A-Z]+")
TUTORIAL = "curling"
"""The task that docs/guide/add-a-task.md makes; tests/documents/test_tutorials.py runs its code."""
OF_THE_PROGRAM = {"--help", "--install-completion", "--show-completion"}
"""Options that act while the line is parsed: nothing is installed by a test."""
NUMBERS = {"N", "TRIAL"}
"""Placeholders that stand for a number."""


def parse(line: str) -> dict[str, object]:
    """The parameters of the command that the line names, nothing executed. Raises TyperException.

    A line that only names a command need not give what the command requires.
    """
    node = PROGRAM
    words = ["1" if word in NUMBERS else word for word in shlex.split(line, comments=True)[1:]]
    context = node.make_context("adaptsim", [], resilient_parsing=True)
    while words and not words[0].startswith("-") and isinstance(node, typer.core.TyperGroup):
        context.resilient_parsing = False  # a command that is not there raises
        name, command, words = node.resolve_command(context, words)
        assert command is not None
        context = command.make_context(name, [], parent=context, resilient_parsing=True)
        node = command  # type: ignore[assignment]
    if not words or OF_THE_PROGRAM & set(words):
        return {}
    return dict(node.make_context(node.name, words, parent=context.parent).params)


def helps(node: typer.core.TyperGroup, name: str = "adaptsim") -> Iterator[tuple[str, str]]:
    """(name, help) of every command at or under `node`, without its groups."""
    for word, command in node.commands.items():
        if isinstance(command, typer.core.TyperGroup):
            if command.invoke_without_command:
                yield f"{name} {word}", command.help or ""
            yield from helps(command, f"{name} {word}")
        else:
            yield f"{name} {word}", command.help or ""


HELPS = dict(helps(PROGRAM))
EXAMPLES = [line for text in HELPS.values() for line in EXAMPLE.findall(text)]


def world_missing(found: dict[str, object]) -> str:
    """Why the world that these parameters name is none of their task's; empty when it is one, or a file."""
    task, world = str(found.get("task") or "scooping"), str(found.get("world") or "wd")
    if PLACEHOLDER.fullmatch(task) or PLACEHOLDER.fullmatch(world) or "/" in world or world.endswith(".toml"):
        return ""
    if task == TUTORIAL:
        return ""
    known = list_worlds(get_task(task))
    return "" if world in known else f"no world {world} of {task}, known: {', '.join(known)}"


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
def test_every_command_parses(document: Path) -> None:
    wrong = []
    for line in commands(read(document)):
        try:
            found = parse(line)
        except typer.TyperException as error:
            wrong.append(f"{line}: {error.format_message()}")
            continue
        if missing := world_missing(found):
            wrong.append(f"{line}: {missing}")
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("command", HELPS)
def test_every_help_ends_with_one_example_of_its_own_command(command: str) -> None:
    (example,) = EXAMPLE.findall(HELPS[command])
    assert f"{example} ".startswith(f"{command} ")
    assert HELPS[command].rstrip().endswith(example)


@pytest.mark.parametrize("example", EXAMPLES)
def test_every_example_of_help_parses_and_names_what_can_exist(example: str, tmp_path: Path) -> None:
    found = parse(example)
    assert not world_missing(found)
    session = found.get("name" if example.startswith("adaptsim sessions") else "session")
    if session is not None:
        assert session in sessions_of_the_readme(tmp_path)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("adaptsim fly", "No such command"),
        ("adaptsim calibrate fly", "No such command"),
        ("adaptsim run-iteration --sped 3", "No such option"),
        ("adaptsim run-iteration -n 0", "greater than or equal to 1|not in the range x>=1"),
        ("adaptsim --sped", "No such option"),
        ("adaptsim sessions redo NAME first", "valid int"),
        ("adaptsim retrack --json", "Missing argument"),
    ],
)
def test_a_wrong_command_is_noticed(line: str, message: str) -> None:
    (found,) = commands(f"see\n```sh\n{line}   # says the comment\n```\n")
    with pytest.raises(typer.TyperException) as raised:
        parse(found)
    assert re.search(message, raised.value.format_message())


def test_commands_are_found_in_fences_indented_and_in_prose() -> None:
    text = "`adaptsim\ndoctor`, not\nadaptsim at large.\n\n    adaptsim lab list\n\n"
    text += "```sh\nA=1 adaptsim report X # y\n```\n"
    assert commands(text) == ["adaptsim report X # y", "adaptsim lab list", "adaptsim doctor"]
    assert parse("adaptsim report X # y")["session"] == "X"


@pytest.mark.parametrize("document", PAGES, ids=shown)
def test_every_link_leads_somewhere(document: Path) -> None:
    wrong = []
    for target in LINK.findall(FENCE.sub("", read(document))):
        if re.match(r"[a-z]+:", target):
            continue
        name, _, anchor = target.partition("#")
        path = (document.parent / name).resolve() if name else document
        if not path.exists():
            wrong.append(f"{target}: no such file")
        elif anchor and anchor not in anchors(path):
            wrong.append(f"{target}: no such heading, known: {', '.join(anchors(path))}")
    assert not wrong, "\n".join(wrong)


def anchors(document: Path) -> list[str]:
    """What the headings of a document are called in links, as GitHub makes it."""
    headings = re.findall(r"^#+ (.*)$", FENCE.sub("", read(document)), re.MULTILINE)
    return [re.sub(r"[^\w\- ]", "", heading.lower()).strip().replace(" ", "-") for heading in headings]


@pytest.mark.parametrize("picture", GUIDE_PICTURES, ids=shown)
def test_pictures_of_the_guide_are_small_and_shown(picture: Path) -> None:
    image = cv2.imread(str(picture))
    assert image is not None
    assert image.shape[1] <= 1200
    assert picture.stat().st_size < 300_000
    assert f"figures/{picture.name})" in (ROOT / "docs/guide/operators-guide.md").read_text(encoding="utf-8")
