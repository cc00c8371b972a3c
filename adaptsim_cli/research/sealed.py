"""Sealed worlds: drawn from a fresh seed that nobody chose, and opened by one version of the code.

`sealed` are forty worlds of the rule `drawn`, `sealed-20` the first twenty; `sealed-foods` are those of the rule
`foods`. The first command that names them draws the seed. The first benchmark opens the seal: it notes the version of
the code, and another version may not run sessions there.
"""

from __future__ import annotations

import re
import secrets
import subprocess
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

from adaptsim_cli.config import Resolved
from adaptsim_cli.errors import UsageError

if TYPE_CHECKING:
    from sim.research.benchmark.worlds import BenchmarkWorld
    from sim.tasks.task import Task

SEALED, LARGEST_SEED = "sealed", 10**9


@dataclass(frozen=True)
class Seal:
    """The seed of the sealed worlds of one task and rule, in a file."""

    path: Path
    rule: str
    seed: int
    count: int  # of worlds, the first ones of the seed

    def worlds(self, task: Task) -> tuple[BenchmarkWorld, ...]:
        """The worlds. Raises UnknownName if the task has none by this rule."""
        from sim.research.benchmark.worlds import RULES, BenchmarkWorld

        rule = RULES[self.rule]
        return tuple(BenchmarkWorld(SEALED, rule(task, self.seed, number)) for number in range(self.count))

    def open(self) -> None:
        """Note the version that opens the seal. Raises UsageError if another version has opened it."""
        from sim.storage.files import read_toml, write_toml

        stored, now = read_toml(self.path), code_version()
        if "commit" not in stored:
            write_toml(self.path, {**stored, "commit": now, "opened": datetime.now(UTC).replace(microsecond=0)})
        elif stored["commit"] != now:
            raise UsageError(
                f"the sealed worlds of seed {self.seed} were opened by version {stored['commit']}, but this is {now}: "
                f"remove {self.path} to draw fresh ones, or go back to that version"
            )


def seal_of(resolved: Resolved, targets: str) -> Seal | None:
    """The seal that `targets` names, drawn now if it is new; None for other targets.

    Raises UsageError for sealed worlds beside others, and for more than there are.
    """
    from sim.research.benchmark.worlds import DRAWN, FOODS, REPORT
    from sim.storage.files import read_toml, write_toml

    if not targets.strip().startswith(SEALED):
        return None
    written = re.fullmatch(rf"{SEALED}(-{FOODS})?(?:-(\d+))?", targets.strip())
    count = int(written[2] or DRAWN) if written else 0
    if written is None or not 2 <= count <= DRAWN:
        raise UsageError(
            f"--targets {targets}: sealed worlds stand alone; write sealed, sealed-foods, or either with a number of "
            f"worlds from 2 to {DRAWN}, for example sealed-20"
        )
    rule = FOODS if written[1] else REPORT
    path = resolved.places.benchmarks / SEALED / f"{Path(resolved.config.task).stem}-{rule}.toml"
    if not path.exists():
        drawn = datetime.now(UTC).replace(microsecond=0)
        write_toml(path, {"seed": secrets.randbelow(LARGEST_SEED), "rule": rule, "drawn": drawn})
    return Seal(path, rule, int(read_toml(path)["seed"]), count)


@cache
def code_version() -> str:
    """The commit of the checkout in which this code lies, with `+changes` if files differ from it; else the version of
    the installed package.
    """
    here = Path(__file__).parent

    def git(*words: str) -> str:
        return subprocess.run(["git", *words], cwd=here, capture_output=True, text=True, check=True).stdout.strip()

    try:
        changed = git("status", "--porcelain", "--untracked-files=no", "--", "../..")
        return git("rev-parse", "HEAD") + ("+changes" if changed else "")
    except (OSError, subprocess.CalledProcessError):
        return version("adaptsim")
