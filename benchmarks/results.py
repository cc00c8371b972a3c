"""Every method in every set of worlds: runs the missing sessions, then writes docs/results/methods.md.

    python benchmarks/results.py            hours; finished parts stay in build/results
    python benchmarks/results.py --short    the pendulum alone with a small budget, half a minute

    python benchmarks/results.py --page-only    the page of what has been run so far; missing cells stay open

It calls `adaptsim world-tables` and `adaptsim benchmark`, and reads the rows of the latter.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hw.types import Array
from sim.research.benchmark.jobs import COMPARED
from sim.research.benchmark.sessions import Conditions

PAGE, FOLDER = Path("docs/results/methods.md"), Path("build/results")
TABLE_A2 = ("wd", "ood-1", "ood-2", "ood-3", "ood-4")
FOODS = ("raisin", "carrot", "cucumber", "sprout", "mushroom-slice", "oreo")
GROUPS = ("foods", "drawn", "Table A2", "selected", "mujoco")
LIMITS = ("oracle", "best-action")
DEFAULT = "adaptsim"


@dataclass(frozen=True)
class Part:
    """The benchmarks of one task."""

    task: str
    seeds: Mapping[str, int]  # sessions of each method in each world, for sets of worlds
    budget: int = 20
    methods: str = "all"
    needs_tables: bool = True

    def commands(self, folder: Path) -> list[list[str]]:
        """One per number of seeds."""
        return [
            [
                "benchmark", "--task", self.task, "--targets", targets, "--methods", self.methods,
                "--budget", str(self.budget), "--seeds", str(seeds), "--out", str(folder / self.task),
            ]
            for targets, seeds in self.seeds.items()
        ]  # fmt: skip


WHOLE = (
    Part("scooping", {",".join(FOODS): 3, "drawn": 1}),
    Part("pushing", {"drawn": 1}),
    Part("pendulum", {"drawn": 1}, budget=10, needs_tables=False),
)
SHORT = (
    Part("pendulum", {"wd,ood-1": 1}, 6, methods="udr,oracle,adaptsim,adaptsim-iteration,random", needs_tables=False),
)

HEAD = """Written by `{command}`. Mean reward of the policy that a session ends with, with its 95 % interval over
worlds. The *foods* are those of the paper. A rule *drew* forty worlds, none discarded. Methods are explained in
[paper](../why/paper.md#baselines), worlds and scores in [benchmark](../reference/benchmark.md). `oracle` and
`best-action` are limits, not methods. Bold: the best method. –: not run.

The comparison is uneven in one point: `adaptsim` and `adaptsim-belief` also weigh parameters of the margin around Ω.
The other methods, and `oracle`, know Ω alone."""

REPORTED = """## Reported by the paper, on a real arm

| | AdaptSim | SysID-Bayes | SysID-Bayes-Point | UDR | LearnInTarget |
| --- | --- | --- | --- | --- | --- |
| pushing, heavy bottle | .83 | .62 | .69 | .70 | .72 |
| pushing, light bottle | .87 | .60 | .71 | .64 | .76 |
| scooping, mean of six foods | .73 | .33 | .35 | .17 | .13 |

Theirs, after five iterations, read off the published figures to about .02. Other objects, another scene and a real
table: they stand here for orientation. The simulated worlds above are not these objects.
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--short", action="store_true", help="the pendulum alone, with a small budget")
    parser.add_argument("--folder", type=Path, default=FOLDER, help="where benchmarks lie (default build/results)")
    parser.add_argument("--page", type=Path, help=f"default: {PAGE}; with --short a file in the folder")
    parser.add_argument("--page-only", action="store_true", help="run nothing, show what there is")
    parser.add_argument("--workers", type=int, default=0, help="processes; 0: one per core")
    asked = parser.parse_args()
    parts = SHORT if asked.short else WHOLE
    for part in () if asked.page_only else parts:
        if part.needs_tables:
            call(["world-tables", "--task", part.task, "--targets", ",".join(part.seeds)], asked.workers)
        for command in part.commands(asked.folder):
            call(command, asked.workers)
    page = asked.page or (asked.folder / "methods.md" if asked.short else PAGE)
    found = {part.task: stored(asked.folder / part.task) for part in parts}
    page.write_text(written(parts, found, short=asked.short), encoding="utf-8")
    print(f"Written: {page}")


def call(arguments: Sequence[str], workers: int) -> None:
    """Run adaptsim; its progress goes to this terminal. Raises SystemExit with its code where it fails."""
    program = "import sys; from adaptsim_cli.app import main; main()"
    done = subprocess.run([sys.executable, "-c", program, *arguments, "--workers", str(workers)], check=False)
    if done.returncode:
        raise SystemExit(done.returncode)


def stored(folder: Path) -> list[dict[str, Any]]:
    """The rows of a benchmark, methods in the program's order."""
    rows = [json.loads(file.read_text(encoding="utf-8")) for file in sorted(folder.glob("rows/*/*/*.json"))]
    return sorted(rows, key=lambda row: COMPARED.index(row["method"]))


def written(parts: Sequence[Part], found: Mapping[str, Sequence[Mapping[str, Any]]], *, short: bool) -> str:
    """The page."""
    lines = [
        "# Results: every method",
        "",
        HEAD.format(command="make results-short" if short else "make results"),
    ]
    for part in parts:
        lines += ["", *section(part, found[part.task])]
    return "\n".join((*lines, "", REPORTED))


def section(part: Part, rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """One task."""
    methods = list(dict.fromkeys(row["method"] for row in rows))
    columns = [group for group in GROUPS if any(group_of(row) == group for row in rows)]
    earned = {(m, c): by_world(rows, m, c) for m in methods for c in columns}
    worlds = {c: max(len(earned[m, c]) for m in methods) for c in columns}
    earned = {at: there for at, there in earned.items() if len(there) == worlds[at[1]]}  # only whole sets are shown
    best = {
        c: max(float(np.mean(earned[m, c])) for m in methods if m not in LIMITS and (m, c) in earned) for c in columns
    }
    head = ["method", *(f"{c} ({_sessions(earned, c)})" for c in columns)]
    body = [
        [f"`{m}`", *(cell(earned.get((m, c), []), best[c], is_limit=m in LIMITS) for c in columns)] for m in methods
    ]
    conditions = Conditions(part.budget)
    if part.needs_tables:
        answered = f"Trials and scores, at {conditions.judged} contexts, are looked up in tables of true rollouts."
    else:
        answered = f"Trials are true rollouts; others, at {conditions.judged} contexts, score a final policy."
    return [
        f"## {part.task.capitalize()}",
        "",
        f"Sessions of {part.budget} trials with {conditions.particles} particles; one training seed; tool driven "
        f"directly. {answered}",
        "",
        *_table(head, body),
        "",
        *paired(rows),
        "",
        *curves(rows),
        *(f"    adaptsim {' '.join(command)}" for command in part.commands(FOLDER)),
    ]


def paired(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """By how much the default method leads every other one, in the same worlds with the same seeds."""
    named = [group for group in GROUPS if any(group_of(row) == group for row in rows)]
    reward = {(r["method"], group_of(r), r["target"], r["seed"]): float(r["reward"]) for r in rows}
    worlds = {s: sorted({r["target"] for r in rows if group_of(r) == s}) for s in named}
    body = []
    for method in dict.fromkeys(row["method"] for row in rows):
        if method == DEFAULT:
            continue
        cells = []
        for s in named:
            ours, theirs = (_means(reward, m, s) for m in (DEFAULT, method))
            whole = ours.keys() == theirs.keys() == set(worlds[s])
            cells.append(lead(np.array([ours[w] - theirs[w] for w in worlds[s]]), worlds[s]) if whole else "–")
        body.append([f"`{method}`", *cells])
    head = [f"`{DEFAULT}` minus", *(f"{s} ({len(worlds[s])} worlds)" for s in named)]
    return [
        "Paired differences of reward, mean over worlds with its 95 % interval, and the world where it is least:",
        "",
        *_table(head, body),
    ]


def curves(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """What sessions of each method earn after each iteration, where trials and scores are of one kind."""
    sets = [group for group in GROUPS if any(group_of(row) == group for row in rows)]
    worlds = {s: {r["target"] for r in rows if group_of(r) == s} for s in sets}
    with_trials = [row for row in rows if len(row["curve"]) > 1]
    after = [n for n, _ in with_trials[0]["curve"]] if with_trials else []
    body = []
    for method in dict.fromkeys(row["method"] for row in with_trials):
        cells = []
        for s in sets:
            there = [r for r in with_trials if (r["method"], group_of(r)) == (method, s)]
            if {r["target"] for r in there} != worlds[s]:
                cells.append("–")
                continue
            earned = np.array([[reward for _, reward in row["curve"]] for row in there]).mean(axis=0)
            cells.append(", ".join(f"{reward:.3f}" for reward in earned))
        body.append([f"`{method}`", *cells])
    told = f"Mean reward after {', '.join(map(str, after[:-1]))} and {after[-1]} trials:" if after else ""
    return [told, "", *_table(["method", *sets], body), ""] if body else []


def _means(reward: Mapping[tuple[str, str, str, int], float], method: str, which: str) -> dict[str, float]:
    """Reward in each world of a set, over its sessions."""
    found: dict[str, list[float]] = {}
    for (m, s, world, _), earned in reward.items():
        if (m, s) == (method, which):
            found.setdefault(world, []).append(earned)
    return {world: float(np.mean(earned)) for world, earned in found.items()}


def lead(differences: Array, worlds: Sequence[str]) -> str:
    """One cell."""
    draws = np.random.default_rng(0).choice(differences, (4000, len(differences))).mean(axis=1)
    low, high = np.quantile(draws, (0.025, 0.975))
    least = int(np.argmin(differences))
    told = f"{differences.mean():+.3f} ({low:+.2f} to {high:+.2f})"
    return f"{told}; {differences[least]:+.2f} in {worlds[least]}"


def _table(head: Sequence[str], body: Sequence[Sequence[str]]) -> list[str]:
    return ["| " + " | ".join(line) + " |" for line in (head, ["---"] * len(head), *body)]


def group_of(row: Mapping[str, Any]) -> str:
    """The set of a row's world; shipped worlds are the foods, those of the paper's table, and selected ones."""
    if row["set"] != "named":
        return str(row["set"])
    return "foods" if row["target"] in FOODS else "Table A2" if row["target"] in TABLE_A2 else "selected"


def _sessions(earned: Mapping[tuple[str, str], Sequence[Sequence[float]]], group: str) -> str:
    """How many of them stand behind a column."""
    worlds = next(there for (_, g), there in earned.items() if g == group)
    return f"{len(worlds)} worlds, {min(map(len, worlds))} each"


def by_world(rows: Sequence[Mapping[str, Any]], method: str, column: str) -> list[list[float]]:
    """Rewards, one list of sessions a world."""
    found: dict[str, list[float]] = {}
    for row in rows:
        if row["method"] == method and group_of(row) == column:
            found.setdefault(row["target"], []).append(row["reward"])
    return list(found.values())


def cell(worlds: Sequence[Sequence[float]], best: float, *, is_limit: bool) -> str:
    """Mean and interval; the best method of a column is bold."""
    if not worlds:
        return "–"
    units: Array = np.array([np.mean(sessions) for sessions in worlds] if len(worlds) > 1 else worlds[0])
    mean = float(np.mean(units))
    told = f"{mean:.3f}"
    if mean >= best - 1e-9 and not is_limit:
        told = f"**{told}**"
    if len(units) < 3:
        return told
    draws = np.random.default_rng(0).choice(units, (4000, len(units))).mean(axis=1)
    low, high = np.quantile(draws, (0.025, 0.975))
    return f"{told} ({low:.2f} to {high:.2f})"


if __name__ == "__main__":
    main()
