"""`docs/check_site.py`: a page that is wider than a phone is named, and a missing browser too."""

from __future__ import annotations

import shutil

import check_site
import pytest


def test_a_folder_without_pages_and_a_machine_without_a_browser_are_named(tmp_path, monkeypatch):
    with pytest.raises(SystemExit, match="holds no pages: build them with make site"):
        check_site.widths(tmp_path, "chromium")
    monkeypatch.setattr(shutil, "which", lambda name: None)
    with pytest.raises(SystemExit, match="no browser: install one of chromium"):
        check_site.main([str(tmp_path)])


def test_pages_wider_than_a_phone_are_named(tmp_path, monkeypatch, capsys):
    page = (tmp_path / "guide/index.html").resolve().as_uri()
    monkeypatch.setattr(shutil, "which", lambda name: name)
    monkeypatch.setattr(check_site, "widths", lambda site, browser: {page: 500})
    assert check_site.main([str(tmp_path)]) == 1
    assert capsys.readouterr().out == "guide/index.html: 500 px wide, a phone has 420\n"
    monkeypatch.setattr(check_site, "widths", lambda site, browser: {page: 420})
    assert check_site.main([str(tmp_path)]) == 0
    assert capsys.readouterr().out == "all 1 pages fit a phone\n"


@pytest.mark.slow
def test_a_browser_measures_them(tmp_path):
    browser = next(path for name in check_site.BROWSERS if (path := shutil.which(name)))
    (tmp_path / "fits.html").write_text("<p>short</p>")
    (tmp_path / "wide.html").write_text('<div style="width: 900px">wide</div>')
    found = check_site.widths(tmp_path, browser)
    assert [px > check_site.PHONE_PX for _, px in sorted(found.items())] == [False, True]
