"""Every page is on the site's menu and in the index of the documents, and a decision fits on a page."""

from __future__ import annotations

import re

from documents import PAGES, ROOT

DOCS = ROOT / "docs"
PAGE_WORDS = 725


def pages() -> list[str]:
    return [str(page.relative_to(DOCS)) for page in PAGES if DOCS in page.parents and page.suffix == ".md"]


def test_every_page_is_on_the_menu_of_the_site() -> None:
    menu = re.findall(r"- (?:\w+: )?(\S+\.md)$", (ROOT / "mkdocs.yml").read_text(encoding="utf-8"), re.MULTILINE)
    assert sorted(menu) == sorted(pages())


def test_every_page_is_linked_from_an_index() -> None:
    indexes = ("README.md", "decisions/README.md", "results.md")
    linked = set[str]()
    for index in indexes:
        folder = (DOCS / index).parent
        for target in re.findall(r"\]\(([^)#\s]+\.md)", (DOCS / index).read_text(encoding="utf-8")):
            linked.add(str((folder / target).resolve().relative_to(ROOT)))
    missing = {f"docs/{page}" for page in pages()} - linked - {"docs/README.md"}
    assert not missing, missing


def test_a_decision_fits_on_a_page() -> None:
    lengths = {page.name: len(page.read_text(encoding="utf-8").split()) for page in (DOCS / "decisions").glob("0*.md")}
    assert len(lengths) > 10
    assert not {name: words for name, words in lengths.items() if words > PAGE_WORDS}
