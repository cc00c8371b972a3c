"""The pages that `make docs` writes are those that the code says now."""

from __future__ import annotations

from typing import ClassVar

import drawings
import pictures
import pytest
from generate import stale
from pages import files
from pages.file_fields import SAID
from pages.files import fields


def test_committed_pages_are_current():
    assert not (old := stale()), f"run `make docs` and commit: {', '.join(old)}"


def test_the_table_of_meanings_has_no_entry_that_no_page_uses(monkeypatch):
    class Asked(dict[str, str]):
        names: ClassVar[set[str]] = set()

        def get(self, name, default=None):
            self.names.add(name)
            return super().get(name, default)

    monkeypatch.setattr(files, "SAID", Asked(SAID))
    files.files()
    assert set(SAID) - Asked.names == set()


def test_a_field_without_a_meaning_is_an_error(tmp_path, monkeypatch):
    (tmp_path / "nameless.py").write_text("class Model:\n    quux: int = 3\n    good: int  # says what it is\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(SystemExit, match="quux says nowhere what it means"):
        list(fields("nameless", "Model"))
    monkeypatch.setitem(SAID, "quux", "a test")
    assert list(fields("nameless", "Model")) == [
        ("quux", "int", "`3`", "a test"),
        ("good", "int", "–", "says what it is"),
    ]


def test_the_pictures_of_the_guide_show_the_program_as_it_is():
    assert not (old := pictures.outdated()), f"run `python docs/pictures.py` and commit: {', '.join(old)}"
    for name, files_that_draw in pictures.DRAWN_BY.items():
        assert (pictures.FIGURES / name).is_file()
        assert all((pictures.ROOT / file).is_file() for file in files_that_draw)


@pytest.mark.parametrize(("name", "draw"), [(drawings.RIG, drawings.rig), (drawings.PEDAL, drawings.pedal)])
def test_the_drawings_of_the_guide_have_the_distances_of_the_program(name, draw, tmp_path):
    made = drawings.write(tmp_path / name, draw)
    assert made.read_text() == (drawings.FIGURES / name).read_text(), "run `python docs/drawings.py` and commit"
