"""Pages that a message names: by their path in a checkout, by their address elsewhere."""

from __future__ import annotations

import re

import pytest
from documents import ROOT

from adaptsim_cli.screen import pages

SENTENCE = "see docs/guide/rig.md#what-a-box-is and docs/guide/own-robot.md."


def test_a_checkout_names_its_own_files(capsys: pytest.CaptureFixture[str]) -> None:
    assert pages.addressed(SENTENCE) == SENTENCE


def test_an_installed_package_prints_the_address(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pages, "_has_documents", lambda: False)
    monkeypatch.setattr(pages, "_documents", lambda: "https://example.org/adaptsim/blob/main/")
    assert pages.addressed(SENTENCE) == (
        "see https://example.org/adaptsim/blob/main/docs/guide/rig.md#what-a-box-is and "
        "https://example.org/adaptsim/blob/main/docs/guide/own-robot.md."
    )


def test_every_page_that_the_program_names_exists() -> None:
    sources = [p for room in ("adaptsim_cli", "calib", "hw", "perception", "sim") for p in (ROOT / room).rglob("*.py")]
    named = {page for source in sources for page in re.findall(r"\bdocs/[\w/-]+\.md", source.read_text("utf-8"))}
    assert named
    assert not [page for page in named if not (ROOT / page).is_file()]
