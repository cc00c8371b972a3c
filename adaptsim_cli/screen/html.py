"""Fills the templates of pages."""

from __future__ import annotations

from functools import cache
from importlib import resources
from typing import TYPE_CHECKING

from adaptsim_cli.screen.svg import plain
from adaptsim_cli.screen.views import between, signed

if TYPE_CHECKING:
    from jinja2 import Template


def fill(template: str, **values: object) -> str:
    """Fill a template, named by its path in the program, with the style and the script of all pages."""
    folder = resources.files("adaptsim_cli.screen")
    style, script = ((folder / name).read_text(encoding="utf-8") for name in ("style.css", "enlarge.js"))
    return _compiled(template).render(style=style, script=script, between=between, **values)


@cache
def _compiled(template: str) -> Template:
    from jinja2 import Environment, StrictUndefined

    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    environment.filters["plain"] = plain
    environment.filters["signed"] = signed
    environment.filters["rounded"] = lambda value: plain(float(f"{value:.2g}"))
    return environment.from_string((resources.files("adaptsim_cli") / template).read_text(encoding="utf-8"))
