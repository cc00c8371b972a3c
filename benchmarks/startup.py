"""What a command costs before it does anything.

    python benchmarks/startup.py
    python benchmarks/startup.py --against FOLDER
    python benchmarks/startup.py --against FOLDER --runs 1 --command "rollout --task scooping --yes"

Without options: `adaptsim --help` beside an empty Typer program; the bar is a factor of 3. With `--against`, a checkout
of another commit: CPU seconds of light commands, or of `--command`, here and there. Both run alternately in fresh
processes, after one run that warms the disk cache; the ratio is the median over the pairs, so that a busy machine
cancels.
"""

from __future__ import annotations

import argparse
import os
import resource
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

LIMIT = 3.0
EMPTY = "import typer\napp = typer.Typer()\n@app.command()\ndef main() -> None:\n    '''Nothing.'''\napp()"
OURS = "from adaptsim_cli.app import main; main()"
HERE = Path(__file__).parents[1]
COMMANDS = ("--help", "config path", "config show", "lab list", "checkpoints list", "doctor")


def cpu_s(program: str, words: list[str], tree: Path) -> float:
    """Of one process and its children."""
    with tempfile.TemporaryDirectory() as home:
        environment = {**os.environ, "PYTHONPATH": str(tree), "ADAPTSIM_HOME": home}
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run(
            [sys.executable, "-c", program, *words],
            check=True,
            stdout=subprocess.DEVNULL,
            env=environment,
            cwd=tree,
        )
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def pairs(one: tuple[str, Path], other: tuple[str, Path], words: list[str], runs: int) -> tuple[float, float, float]:
    """Median CPU seconds of both, and the median ratio of one to the other."""
    measured = [tuple(cpu_s(program, words, tree) for program, tree in (one, other)) for _ in range(runs + 1)][1:]
    first, second = zip(*measured, strict=True)
    return statistics.median(first), statistics.median(second), statistics.median(a / b for a, b in measured)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--against", type=Path, help="checkout of another commit")
    parser.add_argument("--runs", type=int, default=15)
    parser.add_argument("--command", action="append", help="instead of the light commands, repeatable")
    arguments = parser.parse_args()
    if arguments.against is not None:
        print("| command | CPU s there | here | here / there |\n|---|---|---|---|")
        for command in arguments.command or COMMANDS:
            trees = (OURS, HERE), (OURS, arguments.against.absolute())
            ours, theirs, ratio = pairs(*trees, command.split(), arguments.runs)
            print(f"| `adaptsim {command}` | {theirs:.2f} | {ours:.2f} | {ratio:.2f} |", flush=True)
        return 0
    ours, empty, ratio = pairs((OURS, HERE), (EMPTY, HERE), ["--help"], arguments.runs)
    print(f"empty Typer program --help  {1000 * empty:6.0f} ms of CPU")
    print(f"adaptsim --help             {1000 * ours:6.0f} ms")
    print(f"ratio                       {ratio:6.2f}   (limit {LIMIT:g}, median of {arguments.runs} pairs)")
    return 0 if ratio <= LIMIT else 1


if __name__ == "__main__":
    sys.exit(main())
