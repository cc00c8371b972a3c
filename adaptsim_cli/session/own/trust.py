"""A program that a file of the current folder names runs only after the user has confirmed it once.

Such a file may come with somebody else's repository. The confirmation is bound to the command and to the content of
every file that it names.
"""

from __future__ import annotations

import hashlib
import json
import shlex
from pathlib import Path

from adaptsim_cli.config import Resolved
from adaptsim_cli.errors import StoppedByOperator, UsageError
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.screen.keys import Key, stop
from adaptsim_cli.storage import durable
from hw.bounded import read_bytes

_MOST_BYTES = 64 * 2**20


def require_trusted(resolved: Resolved, screen: Screen, *, yes: bool) -> None:
    """Raises UsageError or StoppedByOperator for a program of the project's file that nobody has confirmed."""
    project = str(resolved.places.project_file)
    keys = [key for key in ("answer_with", "answer_moves") if resolved.sources.get(key) == project]
    command = resolved.config.answer_with
    if not keys or command in ("", "person"):
        return
    digest, file = _digest(command, resolved.config.answer_moves), resolved.places.user_file.with_name("trusted.json")
    trusted = _trusted(file)
    if digest in trusted:
        return
    what = f"{project} names the program `{command}`, which moves {resolved.config.answer_moves}"
    if yes:
        raise UsageError(
            f"{what}. A file of the current folder starts no program unasked: confirm it once without --yes, or name "
            f"it yourself with --answer-with, or in {resolved.places.user_file}"
        )
    key = Key("y", "to trust it", "It may run from now on, until the command or a file that it names changes.")
    leave = stop("The command ends; the program has not run.")
    if screen.choose(f"{what}. It is not from your own settings. Do you trust it?", key, leave) == "q":
        raise StoppedByOperator("stopped by the operator; the program has not run")
    durable.make_folder(file.parent)
    durable.replace_file(file, (json.dumps(sorted({*trusted, digest}), indent=1) + "\n").encode())


def _digest(command: str, moves: str) -> str:
    """SHA-256 of the command and of the files that it names."""
    total = hashlib.sha256(json.dumps([command, moves]).encode())
    try:
        words = shlex.split(command)
    except ValueError as error:
        raise UsageError(f"answer_with = {command!r}: {error}") from error
    for word in words:
        path = Path(word).expanduser()
        if path.is_file():
            total.update(hashlib.sha256(read_bytes(path, _MOST_BYTES)).digest())
    return total.hexdigest()


def _trusted(file: Path) -> set[str]:
    try:
        digests = json.loads(read_bytes(file, _MOST_BYTES))
    except (FileNotFoundError, ValueError):
        return set()
    return {str(one) for one in digests} if isinstance(digests, list) else set()
