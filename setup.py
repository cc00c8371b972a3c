"""The parts of the package that `pyproject.toml` cannot state: addresses of the published repository, and a version
without git.

`ADAPTSIM_REPOSITORY_URL` names it (CI sets it), else the remote `origin`. README's links are relative in the
repository; in the metadata they become absolute, so that they work on a package index. In a checkout that was never
published, links into the repository keep their words and lose their target.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path

from setuptools import setup

ROOT = Path(__file__).parent
PAPER = "https://arxiv.org/abs/2302.04903"
LINK = re.compile(r"(!?)\[([^\]]*)\]\((?![a-z]+:|#)([^)\s]+)\)")
BRANCH = "main"


def version_of(description: str) -> str:
    """A version that always parses, from a tag or from the words of `git describe --tags --always`.

    `v0.2.0` -> 0.2.0, `v0.2.0-5-gc4d264d` -> 0.2.0.post5+gc4d264d, `c4d264d` -> 0.0.0+gc4d264d, nothing -> 0.0.0.
    """
    described = re.fullmatch(r"v?(\d+(?:\.\d+)+(?:\.?(?:dev|rc|post)\d+)?)(?:-(\d+)-g([0-9a-f]+))?", description)
    if described is None:
        words = re.sub(r"[^A-Za-z0-9]+", ".", description).strip(".")
        return f"0.0.0+g{words}" if words else "0.0.0"
    release, commits, commit = described.groups()
    return f"{release}.post{commits}+g{commit}" if commits else release


def repository() -> str:
    """Address of the published repository without a slash at the end, empty when there is none."""
    url = os.environ.get("ADAPTSIM_REPOSITORY_URL", "")
    if not url:
        url = re.sub(r"^git@([^:]+):", r"https://\1/", _remote())
    return url.removesuffix("/").removesuffix(".git") if url.startswith("https://") else ""


def _remote() -> str:
    """The address of the remote `origin`; empty where there is none, or no git (in the container)."""
    if shutil.which("git") is None:
        return ""
    asked = ["git", "config", "--get", "remote.origin.url"]
    return subprocess.run(asked, cwd=ROOT, capture_output=True, text=True, check=False).stdout.strip()


def readme(text: str, url: str) -> str:
    """README with absolute links, or with none into the repository where `url` is empty."""

    def absolute(link: re.Match[str]) -> str:
        picture, words, path = link.groups()
        if not url:
            return "" if picture else words
        return f"{picture}[{words}]({url}/{'raw' if picture else 'blob'}/{BRANCH}/{path})"

    return LINK.sub(absolute, text)


def urls(url: str) -> dict[str, str]:
    """The addresses of the project."""
    known = {"Source": url, "Changelog": f"{url}/blob/{BRANCH}/CHANGELOG.md", "Issues": f"{url}/issues"} if url else {}
    return {"Paper": PAPER, **known}


if __name__ == "__main__":
    if "ADAPTSIM_VERSION" in os.environ:  # of a build without git, as in the container
        os.environ["SETUPTOOLS_SCM_PRETEND_VERSION"] = version_of(os.environ["ADAPTSIM_VERSION"])
    setup(
        long_description=readme((ROOT / "README.md").read_text(encoding="utf-8"), repository()),
        long_description_content_type="text/markdown",
        project_urls=urls(repository()),
    )
