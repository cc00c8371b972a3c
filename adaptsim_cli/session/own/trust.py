"""The program that answers for a robot: if the current folder decides which program runs, a person has to confirm it.

A command that a settings file of the current folder names is bound to the folder, to every file in it and to every path
elsewhere that the command names. A command of the user's own settings is bound to the folder whose files it names.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from pathlib import Path

from adaptsim_cli.config import FLAG, PERSON, Resolved
from adaptsim_cli.errors import UsageError
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.trust import PROGRAM, UNREAD, FileClaim, NotCovered, Trust, contents, require, settings_claims

_BETWEEN = re.compile(r"[\s=:;,'\"|&<>(){}]+")


def require_trusted(resolved: Resolved, screen: Screen, *, yes: bool) -> None:
    """Raises UsageError or StoppedByOperator for a program or settings that nobody has confirmed in this folder."""
    claims, trust = own_claims(resolved), Trust(resolved.places.trust_file)
    require(claims, trust, screen, asks=not yes, command="adaptsim config trust --hw own")


def own_claims(resolved: Resolved) -> tuple[FileClaim, ...]:
    """The claims of the current folder on a robot of one's own; none if a person answers or types the program."""
    command, folder = resolved.config.answer_with, resolved.places.project_file.parent.resolve()
    source = resolved.sources.get("answer_with")
    if command in ("", PERSON) or source == FLAG:
        return ()
    if source in resolved.places.foreign_settings:
        return (_claim(resolved, folder, list(_elsewhere(command, folder))),)
    settings = settings_claims(resolved.places)
    return (*settings, _claim(resolved, folder, [])) if _names_file_of(command, folder) else settings


def _claim(resolved: Resolved, folder: Path, elsewhere: list[Path]) -> FileClaim:
    """The command with its folder, its settings, and paths `elsewhere`."""
    command, moves = resolved.config.answer_with, resolved.config.answer_moves
    by = resolved.sources["answer_with"]
    meaning = f"{by} names the program `{command}`, which moves {moves}. It runs in {folder}."
    bound = {"command": command, "moves": moves}
    for claim in settings_claims(resolved.places):
        bound |= claim.content
    try:
        files = contents(folder, *elsewhere)
    except NotCovered as error:
        meaning += (
            f" Only the command itself is confirmed, for this folder: {error}, so a later change of its files is NOT "
            "noticed."
        )
    else:
        bound |= files
        where = ", ".join(map(str, ("this folder", *elsewhere)))
        meaning += f" Bound to {len(files)} files of {where} (except {UNREAD}): a change of any of them asks again."
    return FileClaim(PROGRAM, folder, bound, meaning)


def _words(command: str) -> Iterator[str]:
    """The words of a command, and the parts of each: `--cfg=a.yaml` names a.yaml, `sh -c './r.sh go'` names ./r.sh."""
    try:
        words = shlex.split(command)
    except ValueError as error:
        raise UsageError(f"answer_with = {command!r}: {error}") from error
    for word in words:
        yield from dict.fromkeys((word, *filter(None, _BETWEEN.split(word))))


def _elsewhere(command: str, folder: Path) -> Iterator[Path]:
    """The existing paths outside of the folder that the command names."""
    for word in dict.fromkeys(_words(command)):
        path = folder / Path(word).expanduser()
        if _exists(path) and not path.resolve().is_relative_to(folder):
            yield path.absolute()


def _names_file_of(command: str, folder: Path) -> bool:
    """Whether the command names a file or module of the folder by a relative path."""
    for word in _words(command):
        module = word.replace(".", "/")
        if any(_exists(folder / name) for name in (word, module, f"{module}.py") if not Path(name).is_absolute()):
            return True
    return False


def _exists(path: Path) -> bool:
    try:
        return path.exists()
    except (OSError, ValueError):  # a word that is too long for a name, or holds a zero byte
        return False
