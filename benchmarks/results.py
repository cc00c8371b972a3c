"""Every method in every set of worlds: runs the missing sessions, then writes docs/results/methods.md.

    python benchmarks/results.py              hours; finished sessions stay in build/results
    python benchmarks/results.py --page-only  the page of the sessions that have been run so far
    python benchmarks/results.py --short      the pendulum alone with a small budget, half a minute

It calls `adaptsim world-tables` and `adaptsim benchmark`. Every session is a line of docs/results/sessions.csv, and the
page is made from these lines alone.
"""

from __future__ import annotations

import argparse
import csv
import json
import subprocess
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import stats

from hw.types import Array
from sim.adaptation.methods import method_names
from sim.research.benchmark.sessions import Conditions

PAGE, SESSIONS, FOLDER = Path("docs/results/methods.md"), Path("docs/results/sessions.csv"), Path("build/results")
FOODS = ("raisin", "carrot", "cucumber", "sprout", "mushroom-slice", "oreo")
LIMITS = ("oracle", "best-action")
DEFAULT, FIVE = "adaptsim", ("udr", "adaptsim")
OTHERS = ("adaptsim-iteration", "bo", "bo-prior", "random", "sysid-bayes", *LIMITS)


@dataclass(frozen=True)
class Part:
    """One set of worlds: a section of the page."""

    name: str
    task: str
    targets: str
    seeds: Mapping[tuple[str, ...], int]  # methods -> sessions of each in each world
    budget: int = 20
    fresh: int = 0
    lab: bool = False  # arm, rendered camera and tracking in every trial

    @property
    def needs_tables(self) -> bool:
        """Whether trials and scores are looked up."""
        return self.task != "pendulum"

    def commands(self, folder: Path) -> list[list[str]]:
        """One per number of sessions."""
        options = [*(["--fresh", str(self.fresh)] if self.fresh else []), *(["--lab"] if self.lab else [])]
        return [
            [
                "benchmark", "--task", self.task, "--targets", self.targets, "--methods", ",".join(methods), *options,
                "--budget", str(self.budget), "--seeds", str(seeds), "--out", str(folder / self.name),
            ]
            for methods, seeds in self.seeds.items()
        ]  # fmt: skip


@dataclass(frozen=True)
class Session:
    """The rewards of one session: a line of the table of sessions."""

    part: str
    world: str
    method: str
    seed: int
    reward: float
    after: tuple[tuple[int, float], ...]  # reward after so many trials


Earned = Mapping[str, Mapping[int, float]]
"""world -> seed -> reward"""

WHOLE = (
    Part("foods", "scooping", ",".join(FOODS), {("all",): 3}, fresh=24),
    Part("foods-lab", "scooping", ",".join(FOODS), {FIVE: 1}, fresh=24, lab=True),
    Part("foods-drawn", "scooping", "foods", {("all",): 3}),
    Part("foods-drawn-rollouts", "scooping", "foods", {("udr", "adaptsim", "bo-prior", "random"): 1}, fresh=24),
    Part("scooping", "scooping", "drawn", {FIVE: 5, OTHERS: 1}),
    Part("pushing", "pushing", "drawn", {FIVE: 5, OTHERS: 1}),
    Part("pendulum", "pendulum", "drawn", {FIVE: 5, OTHERS: 1}, budget=10),
)
SHORT = (Part("pendulum", "pendulum", "wd,ood-1", {(*FIVE, "adaptsim-iteration", "random", "oracle"): 1}, 6),)

HEAD = """This page compares all methods. `{command}` runs the sessions and writes this page from
[sessions.csv](sessions.csv), which has a line for each session. *Reward* is the mean reward, between 0 and 1, of the
policy with which a session ends, and its 95 % interval over worlds (bootstrap). *Lead* is the reward of `adaptsim`
minus that of this method, in the same worlds with the same seeds, and then the world in which it is smallest. `oracle`
and `best-action` are limits, not methods: the best E and the best action by the rollouts that trials use. The best
method is bold. Sessions have two particles, and there is one training seed. `adaptsim` is our method;
`adaptsim-iteration` is the paper's ([all methods](../why/paper.md#baselines),
[worlds and scores](../reference/benchmark.md)).

`adaptsim` and `adaptsim-belief` know the margin around Ω. The others, and `oracle`, know only Ω."""

REPORTED = """## Reported by the paper, on a real arm

| | AdaptSim | SysID-Bayes | SysID-Bayes-Point | UDR | LearnInTarget |
| --- | --- | --- | --- | --- | --- |
| pushing, heavy bottle | 0.83 | 0.62 | 0.69 | 0.70 | 0.72 |
| pushing, light bottle | 0.87 | 0.60 | 0.71 | 0.64 | 0.76 |
| scooping, mean of six foods | 0.73 | 0.33 | 0.35 | 0.17 | 0.13 |

These are the paper's own results after five iterations, read from its figures to about 0.02. They are here for
orientation only, because objects, scene and table differ from the simulated worlds above.
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--short", action="store_true", help="the pendulum alone, with a small budget")
    parser.add_argument("--folder", type=Path, default=FOLDER, help="where benchmarks lie (default build/results)")
    parser.add_argument("--page-only", action="store_true", help="run nothing, show what there is")
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--workers", type=int, default=0, help="processes; 0: one per usable core")
    where.add_argument("--scheduler", default="", help="address of a Dask scheduler whose workers simulate")
    asked = parser.parse_args()
    parts = SHORT if asked.short else WHOLE
    place = ["--scheduler", asked.scheduler] if asked.scheduler else ["--workers", str(asked.workers)]
    page, table = (asked.folder / PAGE.name, asked.folder / SESSIONS.name) if asked.short else (PAGE, SESSIONS)
    for part in () if asked.page_only else parts:
        if part.needs_tables:
            call(["world-tables", "--task", part.task, "--targets", part.targets, *place])
        for command in part.commands(asked.folder):
            call([*command, *place])
    known = {(s.part, s.world, s.method, s.seed): s for s in read(table)}
    known |= {(s.part, s.world, s.method, s.seed): s for part in parts for s in stored(asked.folder, part.name)}
    write(table, [known[key] for key in sorted(known)])
    page.write_text(written(parts, read(table), short=asked.short), encoding="utf-8")
    print(f"Written: {page}")


def call(arguments: Sequence[str]) -> None:
    """Run adaptsim; its progress goes to this terminal. Raises SystemExit with its code where it fails."""
    program = "import sys; from adaptsim_cli.commands.app import main; main()"
    done = subprocess.run([sys.executable, "-c", program, *arguments], check=False)
    if done.returncode:
        raise SystemExit(done.returncode)


def stored(folder: Path, part: str) -> Iterable[Session]:
    """The sessions that a benchmark left in its folder."""
    for file in (folder / part).glob("rows/*/*/*.json"):
        row = json.loads(file.read_text(encoding="utf-8"))
        after = tuple((int(n), round(r, 4)) for n, r in row["curve"])
        yield Session(part, row["target"], row["method"], row["seed"], round(row["reward"], 4), after)


def read(table: Path) -> list[Session]:
    """The sessions of the table; none where there is no table yet."""
    if not table.exists():
        return []
    with table.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    after = [(pair.split(":") for pair in row["after"].split()) for row in rows]
    curves = [tuple((int(n), float(reward)) for n, reward in pairs) for pairs in after]
    return [
        Session(r["part"], r["world"], r["method"], int(r["seed"]), float(r["reward"]), curve)
        for r, curve in zip(rows, curves, strict=True)
    ]


def write(table: Path, sessions: Iterable[Session]) -> None:
    """Write the table, with one line per session."""
    with table.open("w", encoding="utf-8", newline="") as file:
        out = csv.writer(file, lineterminator="\n")
        out.writerow(("part", "world", "method", "seed", "reward", "after"))
        for s in sessions:
            out.writerow((s.part, s.world, s.method, s.seed, s.reward, " ".join(f"{n}:{r}" for n, r in s.after)))


def written(parts: Sequence[Part], sessions: Sequence[Session], *, short: bool) -> str:
    """The page."""
    lines = ["# Results: every method", "", HEAD.format(command="make results-short" if short else "make results")]
    for part in parts:
        here = [s for s in sessions if s.part == part.name]
        lines += ["", *(section(part, here) if here else ())]
    return "\n".join((*lines, "", REPORTED))


def section(part: Part, sessions: Sequence[Session]) -> list[str]:
    """The table of one set of worlds; a method is shown if it ran in all of them."""
    worlds = sorted({s.world for s in sessions})
    earned = {m: by_world(sessions, m) for m in (*method_names(), *LIMITS)}
    earned = {method: rewards for method, rewards in earned.items() if rewards.keys() == set(worlds)}
    best = max(means(rewards).mean() for m, rewards in earned.items() if m not in LIMITS)
    after = max((s.after for s in sessions), key=len)
    trials = ", ".join(str(n) for n, _ in after)
    head = ["method", "sessions per world", "reward", "lead", f"after {trials} trials"]
    body = [
        [
            f"`{method}`",
            str(min(map(len, rewards.values()))),
            reward(rewards, best, is_limit=method in LIMITS),
            "" if method == DEFAULT or DEFAULT not in earned else lead(earned[DEFAULT], rewards),
            course(sessions, method),
        ]
        for method, rewards in earned.items()
    ]
    judged = part.fresh or Conditions(part.budget).judged
    kind = f"looked up in tables of true rollouts, scored at {judged} contexts"
    if not part.needs_tables or part.fresh:
        kind = f"true rollouts; {judged} further ones score the final policy"
    if part.needs_tables and part.fresh:
        kind += ", and tables of true rollouts score the earlier ones"
    how = "through the whole lab: arm, rendered camera, tracking" if part.lab else "without arm or camera"
    return [
        f"## {part.name.capitalize().replace('-lab', ' in the whole lab')}",
        "",
        f"{len(worlds)} worlds, sessions of {part.budget} trials, {how}. Trials are {kind}.",
        "",
        *("| " + " | ".join(line) + " |" for line in (head, ["---"] * len(head), *body)),
        "",
        *(f"    adaptsim {' '.join(command)}" for command in part.commands(FOLDER)),
    ]


def by_world(sessions: Sequence[Session], method: str) -> Earned:
    """Rewards of a method's sessions."""
    rewards: dict[str, dict[int, float]] = {}
    for s in sessions:
        if s.method == method:
            rewards.setdefault(s.world, {})[s.seed] = s.reward
    return rewards


def means(earned: Earned) -> Array:
    """(W,) reward in each world."""
    return np.array([np.mean(list(seeds.values())) for seeds in earned.values()])


def reward(earned: Earned, best: float, *, is_limit: bool) -> str:
    """Mean over worlds and its interval; the best method of a section is bold."""
    units = means(earned)
    text = f"{units.mean():.3f}"
    if units.mean() >= best - 1e-9 and not is_limit:
        text = f"**{text}**"
    return text if len(units) < 3 else "{} ({:.3f} to {:.3f})".format(text, *interval(units))


def lead(ours: Earned, theirs: Earned) -> str:
    """Paired difference over worlds, its interval, and the world where it is least."""
    differences = {
        world: float(np.mean([ours[world][seed] - reward for seed, reward in seeds.items()]))
        for world, seeds in theirs.items()
    }
    least = min(differences, key=lambda world: differences[world])
    units: Array = np.array(list(differences.values()))
    span = "" if len(units) < 3 else " ({:+.3f} to {:+.3f})".format(*interval(units))
    return f"{units.mean():+.3f}{span}; {differences[least]:+.2f} in {least}"


def interval(units: Array) -> tuple[float, float]:
    """95 % interval of the mean, by bootstrap."""
    ends = stats.bootstrap((units,), np.mean, n_resamples=4000, method="percentile", rng=0).confidence_interval
    return float(ends.low), float(ends.high)


def course(sessions: Sequence[Session], method: str) -> str:
    """Mean reward after each iteration."""
    curves = [[r for _, r in s.after] for s in sessions if s.method == method]
    whole = len(curves[0]) > 1 and len({len(curve) for curve in curves}) == 1
    return ", ".join(f"{r:.3f}" for r in np.mean(curves, axis=0)) if whole else ""


if __name__ == "__main__":
    main()
