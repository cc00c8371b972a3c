"""How long `adaptsim --help` takes, beside an empty Typer program; the bar is a factor of 3.

Both run alternately in fresh processes; the median of RUNS each counts, after one run that warms the disk cache.
"""

from __future__ import annotations

import statistics
import subprocess
import sys
import time

RUNS = 15
LIMIT = 3.0
EMPTY = "import typer\napp = typer.Typer()\n@app.command()\ndef main() -> None:\n    '''Nothing.'''\napp()"
OURS = "from adaptsim_cli.app import main; main()"


def seconds(program: str) -> float:
    began = time.perf_counter()
    subprocess.run([sys.executable, "-c", program, "--help"], check=True, stdout=subprocess.DEVNULL)
    return time.perf_counter() - began


def main() -> int:
    times: dict[str, list[float]] = {EMPTY: [], OURS: []}
    for run in range(RUNS + 1):
        for program, measured in times.items():
            spent = seconds(program)
            if run > 0:
                measured.append(spent)
    empty, ours = (statistics.median(measured) for measured in times.values())
    print(f"empty Typer program --help  {1000 * empty:6.0f} ms")
    print(f"adaptsim --help             {1000 * ours:6.0f} ms")
    print(f"ratio                       {ours / empty:6.2f}   (limit {LIMIT:g}, median of {RUNS} runs each)")
    return 0 if ours <= LIMIT * empty else 1


if __name__ == "__main__":
    sys.exit(main())
