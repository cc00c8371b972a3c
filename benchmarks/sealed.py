"""Stores the results of a sealed benchmark for the page docs/results/sealed.md, which `make docs` writes.

The folder is that of `adaptsim benchmark --targets sealed`. Worlds in which an entry is missing, because the run was
stopped, are left out from there on, so that the first worlds of the seed remain. Several folders are runs with one
checkpoint each, and `--with` adds a stored run as the first of them. An entry counts if every training has a result of
it in a world.

    python benchmarks/sealed.py FOLDER... SEAL.toml --command "adaptsim benchmark ..."
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from sim.storage.files import read_toml, whole_file

OUT = Path("docs/results/sealed")


def stored(folder: Path, seal: Path) -> dict[str, Any]:
    """The conditions and the rows of the first worlds in which every entry has a result."""
    plan, sealed = read_toml(folder / "benchmark.toml"), read_toml(seal)
    if plan["sealed"] != {"seed": sealed["seed"], "commit": sealed["commit"]}:
        raise SystemExit(f"{folder} does not belong to {seal}: its seed or commit differs")
    rows = [json.loads(path.read_text(encoding="utf-8")) for path in sorted((folder / "rows/sealed").glob("*/*.json"))]
    entries = {row["method"] for row in rows}
    seeds = {row["seed"] for row in rows}
    kept: list[list[Any]] = []
    number = 0
    while True:
        world = f"{sealed['rule']}-{sealed['seed']}-{number}"
        mine = [row for row in rows if row["target"] == world]
        if len(mine) < len(entries) * len(seeds):
            break
        kept += [[world, r["method"], r["seed"], round(r["reward"], 4), r["shown"]] for r in mine]
        number += 1
    return {
        "task": plan["task"],
        **{key: sealed[key] if isinstance(sealed[key], (int, str)) else str(sealed[key]) for key in sealed},
        "trials": plan["conditions"]["budget"],
        "checkpoints": plan["checkpoints"],
        "worlds": number,
        "rows": kept,
    }


def together(runs: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """One result of runs with a checkpoint each. The seed of a row is the number of its training."""
    if len({json.dumps([run[key] for key in ("task", "seed", "commit", "trials")]) for run in runs}) > 1:
        raise SystemExit("these runs differ in more than their checkpoints")
    common = set.intersection(*({(row[0], row[1]) for row in run["rows"]} for run in runs))
    rows = [
        [world, entry, training, reward, shown]
        for training, run in enumerate(runs)
        for world, entry, _, reward, shown in run["rows"]
        if (world, entry) in common
    ]
    worlds = len({world for world, _ in common})
    return {
        **runs[0],
        "checkpoints": [one for run in runs for one in run["checkpoints"]],
        "worlds": worlds,
        "rows": rows,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", type=Path, nargs="+")
    parser.add_argument("seal", type=Path)
    parser.add_argument("--command", required=True, help="the command that repeats the run")
    parser.add_argument("--note", default="", help="one sentence on the conditions")
    parser.add_argument("--with", dest="known", default="", help="name of a stored file: the first training")
    parser.add_argument("--name", help="name of the stored file; by default TASK-RULE")
    wanted = parser.parse_args()
    known = [json.loads((OUT / f"{wanted.known}.json").read_text(encoding="utf-8"))] if wanted.known else []
    runs = [*known, *(stored(folder, wanted.seal) for folder in wanted.folders)]
    result = {**together(runs), "command": wanted.command, "note": wanted.note}
    OUT.mkdir(parents=True, exist_ok=True)
    name = wanted.name or f"{result['task']}-{result['rule']}"
    with whole_file(OUT / f"{name}.json") as temporary:
        temporary.write_text(json.dumps(result, indent=None) + "\n", encoding="utf-8")
    print(f"{result['worlds']} worlds of {result['task']}")


if __name__ == "__main__":
    main()
