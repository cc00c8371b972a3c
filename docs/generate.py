"""Write the pages of the documentation that follow from the code: `make docs`.

    python docs/generate.py            write them
    python docs/generate.py --check    exit code 1 if a committed page is out of date

Commands come from the Typer app, file formats from the models that read and write them, and parameters and actions
from the tasks. Numbers in hand-written pages that have an
expression beside them are computed again (`pages/numbers.py`).
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

from pages import ROOT
from pages.cheat_sheet import cheat_sheet
from pages.commands import commands
from pages.files import files
from pages.json_output import json_output
from pages.method_figure import method_figure
from pages.numbers import hand_written, with_numbers
from pages.paper_settings import paper_settings, paper_settings_figure
from pages.parameters import parameters
from pages.result_figures import reward_by_trials, reward_by_world
from pages.sealed import own_actions, sealed

DOCS = ROOT / "docs"

PAGES: Mapping[Path, Callable[[], str]] = {
    DOCS / "reference/commands.md": commands,
    DOCS / "reference/cheat-sheet.md": cheat_sheet,
    DOCS / "reference/parameters.md": parameters,
    DOCS / "reference/files.md": files,
    DOCS / "reference/json.md": json_output,
    DOCS / "results/sealed.md": sealed,
    DOCS / "results/what-there-is-to-adapt.md": own_actions,
    DOCS / "results/paper-settings.md": paper_settings,
    DOCS / "figures/paper-settings.svg": paper_settings_figure,
    DOCS / "figures/method.svg": method_figure,
    DOCS / "figures/reward-by-trials.svg": reward_by_trials,
    DOCS / "figures/reward-by-world.svg": reward_by_world,
    **{page: partial(with_numbers, page) for page in hand_written()},
}


def stale() -> list[str]:
    """The committed pages that differ from those of the present code."""
    return [str(p.relative_to(ROOT)) for p, make in PAGES.items() if not p.is_file() or p.read_text("utf-8") != make()]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true")
    if parser.parse_args().check:
        old = stale()
        print("\n".join(old) if old else "every page is current")
        return 1 if old else 0
    for path, make in PAGES.items():
        path.write_text(make(), encoding="utf-8")
        print(path.relative_to(ROOT))
    return 0


if __name__ == "__main__":
    sys.exit(main())
