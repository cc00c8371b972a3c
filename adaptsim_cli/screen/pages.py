"""Where a reader finds a page of the documentation that a message names."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import adaptsim_cli

_PAGE = re.compile(r"\bdocs/[\w/-]+\.(?:md|ipynb)(?:#[\w-]+)?")


def addressed(text: str) -> str:
    """The text, with an address for every page that it names, if this installation has no `docs` folder beside it."""
    return text if _has_documents() else _PAGE.sub(lambda page: f"{_documents()}{page.group()}", text)


def _has_documents() -> bool:
    return (Path(adaptsim_cli.__file__).parents[1] / "docs").is_dir()


@cache
def _documents() -> str:
    """The address of the repository's files, with a slash at its end; "" if the package's metadata do not give it."""
    from importlib import metadata  # with its parser of e-mails, a twentieth of a short command

    for line in metadata.metadata("adaptsim").get_all("Project-URL") or ():
        label, _, address = line.partition(", ")
        if label == "Source":
            return f"{address}/blob/main/"
    return ""
