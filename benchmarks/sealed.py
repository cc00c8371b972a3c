"""Stores the results of a sealed benchmark for the page docs/results/sealed.md, which `make docs` writes.

The folder is that of `adaptsim benchmark --targets sealed`. Worlds in which an entry is missing, because the run was
stopped, are left out from there on, so that the first worlds of the seed remain.

    python benchmarks/sealed.py FOLDER SEAL.toml --command "adaptsim benchmark ..."
"""

from __future__ import annotations

import argparse
import json
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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("seal", type=Path)
    parser.add_argument("--command", required=True, help="the command that repeats the run")
    parser.add_argument("--note", default="", help="one sentence on the conditions")
    parser.add_argument("--name", help="name of the stored file; by default TASK-RULE")
    wanted = parser.parse_args()
    result = {**stored(wanted.folder, wanted.seal), "command": wanted.command, "note": wanted.note}
    OUT.mkdir(parents=True, exist_ok=True)
    name = wanted.name or f"{result['task']}-{result['rule']}"
    with whole_file(OUT / f"{name}.json") as temporary:
        temporary.write_text(json.dumps(result, indent=None) + "\n", encoding="utf-8")
    print(f"{result['worlds']} worlds of {result['task']}")


if __name__ == "__main__":
    main()
