"""Installed packages, and the command for an optional extra, which depends on how the program itself was installed."""

from __future__ import annotations

import importlib.metadata
import json
from contextlib import suppress
from functools import cache
from pathlib import Path
from urllib.parse import unquote, urlparse

PROGRAM = "adaptsim"


def install_line(extra: str) -> str:
    """The command that installs an extra: from the checkout that the program runs from, else from the package index."""
    folder, editable = _origin()
    if folder is None:
        return f"pip install '{PROGRAM}[{extra}]'"
    return f"pip install {'-e ' if editable else ''}'{folder}[{extra}]'"


def missing(feature: str, package: str, extra: str) -> str:
    """The sentence that `feature` needs a package which is not installed."""
    return f"{feature} needs the package {package}, which is not installed: {install_line(extra)}"


def installed(*packages: str) -> dict[str, str]:
    """The versions of those packages that are installed."""
    versions = {}
    for package in packages:
        with suppress(importlib.metadata.PackageNotFoundError):
            versions[package] = importlib.metadata.version(package)
    return versions


@cache
def _origin() -> tuple[Path | None, bool]:
    """The folder from which the program was installed, if there is one, and whether it runs from there (PEP 610)."""
    try:
        text = importlib.metadata.distribution(PROGRAM).read_text("direct_url.json")
    except importlib.metadata.PackageNotFoundError:
        text = None
    origin = json.loads(text) if text else {}
    if "dir_info" not in origin:
        return None, False
    return Path(unquote(urlparse(origin["url"]).path)), bool(origin["dir_info"].get("editable"))
