"""What a command costs before it does anything.

    python benchmarks/startup.py
    python benchmarks/startup.py --against FOLDER
    python benchmarks/startup.py --against FOLDER --runs 1 --command "rollout --task scooping --yes"
    python benchmarks/startup.py --against FOLDER --runs 3 --clock --command "run-iteration --task scooping --yes"

Without options: `adaptsim --help` beside an empty Typer program; the bar is a factor of 3. With `--against`, a checkout
of another commit: CPU seconds of light commands, or of `--command`, here and there. Both run alternately in fresh
processes, after one run that warms the disk cache; the ratio is the median over the pairs, so that a busy machine
cancels. With `--clock` seconds by the clock, which need a quiet machine.
"""

from __future__ import annotations

import argparse
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

LIMIT = 3.0
EMPTY = "import typer\napp = typer.Typer()\n@app.command()\ndef main() -> None:\n    '''Nothing.'''\napp()"
OURS = "from adaptsim_cli.app import main; main()"
HERE = Path(__file__).parents[1]
COMMANDS = ("--help", "config path", "config show", "lab list", "checkpoints list", "doctor")


def cpu_s() -> float:
    """Of all children that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


Clock = Callable[[], float]


def spent_s(program: str, words: list[str], tree: Path, clock: Clock) -> float:
    """Of one process and its children."""
    with tempfile.TemporaryDirectory() as home:
        environment = {**os.environ, "PYTHONPATH": str(tree), "ADAPTSIM_HOME": home}
        before_s = clock()
        subprocess.run(
            [sys.executable, "-c", program, *words],
            check=True,
            stdout=subprocess.DEVNULL,
            env=environment,
            cwd=tree,
        )
        return clock() - before_s


def pairs(
    one: tuple[str, Path], other: tuple[str, Path], words: list[str], runs: int, clock: Clock
) -> tuple[float, float, float]:
    """Median seconds of both, and the median ratio of one to the other."""
    both = one, other
    measured = [tuple(spent_s(program, words, tree, clock) for program, tree in both) for _ in range(runs + 1)][1:]
    first, second = zip(*measured, strict=True)
    return statistics.median(first), statistics.median(second), statistics.median(a / b for a, b in measured)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--against", type=Path, help="checkout of another commit")
    parser.add_argument("--runs", type=int, default=15)
    parser.add_argument("--command", action="append", help="instead of the light commands, repeatable")
    parser.add_argument("--clock", action="store_true", help="seconds by the clock instead of CPU")
    arguments = parser.parse_args()
    clock = time.monotonic if arguments.clock else cpu_s
    if arguments.against is not None:
        print(f"| command | {'s' if arguments.clock else 'CPU s'} there | here | here / there |\n|---|---|---|---|")
        for command in arguments.command or COMMANDS:
            trees = (OURS, HERE), (OURS, arguments.against.absolute())
            ours, theirs, ratio = pairs(*trees, command.split(), arguments.runs, clock)
            print(f"| `adaptsim {command}` | {theirs:.2f} | {ours:.2f} | {ratio:.2f} |", flush=True)
        return 0
    ours, empty, ratio = pairs((OURS, HERE), (EMPTY, HERE), ["--help"], arguments.runs, cpu_s)
    print(f"empty Typer program --help  {1000 * empty:6.0f} ms of CPU")
    print(f"adaptsim --help             {1000 * ours:6.0f} ms")
    print(f"ratio                       {ratio:6.2f}   (limit {LIMIT:g}, median of {arguments.runs} pairs)")
    return 0 if ratio <= LIMIT else 1


if __name__ == "__main__":
    sys.exit(main())
