"""How often does the screen of a session claim a difference where there is none?

    python benchmarks/no_difference.py --sessions 40

Each session compares UDR with UDR (`run-iteration --method udr --control udr`), in pushing in MuJoCo. The parameters
are those of drawn worlds (seed 3), and noise differs from trial to trial. Every claim of the screen is counted, because
a person may read it after each iteration. Sessions are stored in `--out`; the same command continues.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from collections import Counter
from pathlib import Path
from typing import Any

from sim.adaptation.paired import Claim
from sim.lab.drawn import drawn_world
from sim.tasks import get_task
from sim.tasks.task import Task

DRAW_SEED, ITERATIONS = 3, 4


def world_file(task: Task, number: int, folder: Path) -> Path:
    """The parameters of a drawn world, in MuJoCo; its unmodelled effects stay out."""
    world, path = drawn_world(task, DRAW_SEED, number), folder / f"world-{number}.toml"
    names = [dimension.name for dimension in task.parameters.dimensions]
    lines = [f"{name} = {float(value)!r}" for name, value in zip(names, world.parameters, strict=True)]
    head = f'task = "{task.name}"\nphysics = "mujoco"\ndescription = "parameters of {world.name}"\n\n[params]\n'
    path.write_text(head + "\n".join(lines) + "\n", encoding="utf-8")
    return path


def claims(task: Task, number: int, folder: Path) -> list[dict[str, Any]]:
    """The sentence of the session about the pairs after each iteration."""
    file = folder / f"session-{number}.json"
    if not file.exists():
        command = [sys.executable, "-m", "adaptsim_cli", "run-iteration", "--task", task.name]
        command += ["--world", str(world_file(task, number, folder)), "--method", "udr", "--control", "udr"]
        command += ["--seed", str(number), "--session", f"s{number}", "-n", str(ITERATIONS), "--yes", "--json"]
        home = {**os.environ, "ADAPTSIM_HOME": str(folder / "home")}
        output = subprocess.run(command, capture_output=True, text=True, check=True, env=home).stdout
        outputs = [json.loads(line) for line in output.splitlines() if line.startswith("{")]
        file.write_text(json.dumps([one["control"] for one in outputs if one["control"] is not None]))
    content: list[dict[str, Any]] = json.loads(file.read_text())
    return content


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sessions", type=int, default=40)
    parser.add_argument("--out", type=Path, default=Path("build/no-difference"))
    asked = parser.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)
    task, ever, pairs = get_task("pushing"), Counter[str](), 0
    for number in range(asked.sessions):
        records = claims(task, number, asked.out)
        made = {one["claim"] for one in records} - {Claim.OPEN.value}
        ever.update(made or {"none"})
        pairs = records[-1]["pairs"]
    wrong = ever[Claim.SHOWN.value] + ever[Claim.WORSE.value]
    print(f"{asked.sessions} sessions of {pairs} pairs, read after each iteration: {wrong} claimed a difference")
    print(", ".join(f"{claim}: {count}" for claim, count in ever.items()))


if __name__ == "__main__":
    main()
