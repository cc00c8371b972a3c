"""README as a package index shows it: every link is absolute, and leads to a file of the repository."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[2]
URL = "https://git.example/lab/adaptsim"
TARGET = re.compile(r"\]\(([^)\s]+)\)")


@pytest.fixture(scope="module")
def setup() -> ModuleType:
    spec = importlib.util.spec_from_file_location("adaptsim_setup", ROOT / "setup.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_link_is_absolute_and_leads_to_a_file(setup: ModuleType) -> None:
    text = setup.readme((ROOT / "README.md").read_text(encoding="utf-8"), URL)
    targets = TARGET.findall(text)
    assert len(targets) > 20
    for target in targets:
        assert re.match(r"https?://", target), target
        if target.startswith(URL):
            path = re.fullmatch(rf"{URL}/(?:blob|raw)/main/([^#]*)(?:#.*)?", target)
            assert path is not None and (ROOT / path[1]).is_file(), target


def test_pictures_are_raw_files_and_pages_are_not(setup: ModuleType) -> None:
    text = setup.readme("![a](docs/figures/session.jpg) [b](docs/README.md#start) [c](https://arxiv.org/x)", URL)
    assert (
        text
        == f"![a]({URL}/raw/main/docs/figures/session.jpg) [b]({URL}/blob/main/docs/README.md#start) [c](https://arxiv.org/x)"
    )


def test_without_a_repository_links_keep_their_words(setup: ModuleType) -> None:
    assert (
        setup.readme("![a](x.png)see [b](docs/README.md), [c](https://arxiv.org/x)", "")
        == "see b, [c](https://arxiv.org/x)"
    )
    assert setup.urls("") == {"Paper": setup.PAPER}
    assert setup.urls(URL)["Issues"] == f"{URL}/issues"


def test_the_readme_has_a_picture_that_is_small() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    first = re.search(r"!\[[^\]]+\]\((\S+\.(?:png|jpg))\)", text)
    assert first is not None
    assert (ROOT / first[1]).stat().st_size < 400_000
    assert text.index(first[0]) < 100
