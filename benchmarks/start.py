"""The processor time of short commands, as ratios of one run.

    python benchmarks/start.py [--turns 6]

`--help` is compared with an empty typer program, and each list with `--help`. In each turn every program runs once, so
that a busy computer disturbs all of them alike. Modules are compiled once, before the turns, as an installer does.
Prints the medians of the turns; times are user plus system.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

EMPTY = "import typer\napp = typer.Typer()\n@app.command()\ndef one(): ...\n@app.command()\ndef two(): ...\napp()\n"
"""A typer program with two commands that do nothing."""

LISTS = ("checkpoints list", "lab list", "sessions list")


def processor_s(command: list[str], folder: str) -> float:
    """Processor time of a command, with data and compiled modules in `folder`. Raises CalledProcessError."""
    before = os.times()
    environment = {**os.environ, "ADAPTSIM_HOME": folder, "PYTHONPYCACHEPREFIX": f"{folder}/compiled"}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, env=environment)
    after = os.times()
    return after.children_user + after.children_system - before.children_user - before.children_system


def main() -> None:
    """Time all programs in turns."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--turns", type=int, default=6)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        empty = Path(folder) / "empty.py"
        empty.write_text(EMPTY, encoding="utf-8")
        programs = {"empty typer program": [sys.executable, str(empty), "--help"]}
        for words in ("--help", *LISTS):
            programs[words] = [sys.executable, "-m", "adaptsim_cli", *words.split()]
        times_s: dict[str, list[float]] = {name: [] for name in programs}
        for turn in range(-1, options.turns):  # the first turn compiles, fills caches and does not count
            for name, command in programs.items():
                spent_s = processor_s(command, folder)
                if turn >= 0:
                    times_s[name].append(spent_s)
    median_s = {name: statistics.median(spent_s) for name, spent_s in times_s.items()}
    bases = dict.fromkeys(LISTS, "--help") | {"--help": "empty typer program"}
    for name, spent_s in median_s.items():
        compared = f", {spent_s / median_s[bases[name]]:.2f} times {bases[name]}" if name in bases else ""
        print(f"{name}: {spent_s:.2f} s{compared}")


if __name__ == "__main__":
    main()
