"""Numbers in hand-written pages that the program or the table of sessions decides.

An author writes `0.00<!--= mean("foods", "udr") -->`: `make docs` evaluates the comment and replaces the number before it.
The number says how it is written: its decimals, a sign for every value (`+0.000`), or a share (`0 %`). A text in place of
a number, such as the name of a world, is replaced as a whole.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import results

from adaptsim_cli.bench.doctor import separation
from adaptsim_cli.bench.rig_file.description import PersonPart
from hw import braking, stopping, watchdog
from pages import ROOT
from pages.sealed import sealed_entry, sealed_summary
from sim.research.benchmark.strata import ALL

SESSIONS, STOPS = ROOT / "docs/results/sessions.csv", ROOT / "docs/results/motion.md"
FILLED = re.compile(r"(?P<old>[+−-]?\w[\w.-]*)(?P<share> %)?<!--= (?P<expression>.*?) -->")
GAIN = 0.05
"""The least gain of reward with which a world counts as one that gains."""

Rewards = Mapping[str, float]
"""world -> mean reward of its sessions"""


def with_numbers(page: Path) -> str:
    """The text of a hand-written page, with every number that has an expression computed again.

    Raises SystemExit, with page and expression, where one cannot be computed.
    """

    def number(match: re.Match[str]) -> str:
        try:
            value = eval(match["expression"], dict(NAMES))  # noqa: S307 - our own pages
        except Exception as error:
            raise SystemExit(f"{page.name}: {match['expression']} cannot be computed: {error!r}") from error
        written = value if isinstance(value, str) else _written(value, match["old"], is_share=bool(match["share"]))
        return f"{written}{match['share'] or ''}<!--= {match['expression']} -->"

    return FILLED.sub(number, page.read_text(encoding="utf-8"))


def hand_written() -> list[Path]:
    """The pages with such numbers."""
    pages = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
    return [page for page in pages if FILLED.search(page.read_text(encoding="utf-8"))]


def _written(value: float, old: str, *, is_share: bool) -> str:
    """`value` in the format of the number that it replaces, with a true minus."""
    decimals = len(old.partition(".")[2])
    sign = "+" if old[0] in "+−-" else ""
    return f"{100.0 * value if is_share else value:{sign}.{decimals}f}".replace("-", "−")


@cache
def _sessions(part: str) -> list[results.Session]:
    return [one for one in results.read(SESSIONS) if one.part == part]


@cache
def _rewards(part: str, method: str, after: int, sessions: int) -> Rewards:
    by_world: dict[str, list[float]] = {}
    for one in _sessions(part):
        if one.method == method and one.seed < sessions:
            by_world.setdefault(one.world, []).append(dict(one.after)[after] if after else one.reward)
    return {world: float(np.mean(rewards)) for world, rewards in by_world.items()}


def mean(part: str, method: str, world: str = "", *, after: int = 0, sessions: int = 1_000) -> float:
    """Mean reward over the worlds of a part (or in one world), at the end or after so many trials."""
    rewards = _rewards(part, method, after, sessions)
    return rewards[world] if world else float(np.mean(list(rewards.values())))


def gains(part: str, over: str = "udr") -> Rewards:
    """The reward of `adaptsim` minus that of another method in each world."""
    other = _rewards(part, over, 0, 1_000)
    return {world: reward - other[world] for world, reward in _rewards(part, "adaptsim", 0, 1_000).items()}


@cache
def lead(part: str, over: str = "udr", *, end: int = 0) -> float:
    """The mean reward of `adaptsim` minus that of another method, in the same worlds with the same seeds; `end` −1 and
    1: the ends of its 95 % interval.
    """
    ours, theirs = (results.by_world(_sessions(part), method) for method in ("adaptsim", over))
    units = np.array([np.mean([ours[w][s] - reward for s, reward in seeds.items()]) for w, seeds in theirs.items()])
    return results.interval(units)[end > 0] if end else float(units.mean())


@cache
def change(part: str, before: str, method: str, *, sessions: int = 1_000, end: int = 0) -> float:
    """The mean reward of a method in the worlds of a part minus that in an earlier part with the same worlds; `end` as
    in `lead`.
    """
    now, then = (_rewards(one, method, 0, sessions) for one in (part, before))
    units = np.array([reward - then[world] for world, reward in now.items()])
    return results.interval(units)[end > 0] if end else float(units.mean())


def gaining(part: str) -> int:
    """In how many worlds `adaptsim` gains over UDR."""
    return sum(gain >= GAIN for gain in gains(part).values())


def worlds(part: str) -> int:
    return len(gains(part))


def least(part: str) -> float:
    return min(gains(part).values())


def least_world(part: str) -> str:
    return min(gains(part), key=gains(part).__getitem__)


def sealed(name: str, entry: str = "adaptsim", *, stratum: str = ALL, end: int = 0) -> float:
    """Mean reward in a sealed benchmark, such as `pushing-drawn`, in all worlds, those `in need` or the `others`; `end`
    −1 and 1: the ends of its 95 % interval.
    """
    one = sealed_entry(name, entry, stratum)
    return one.ci95[end > 0] if end else one.reward


def sealed_lead(name: str, entry: str, *, stratum: str = ALL, end: int = 0) -> float:
    """What `adaptsim` earns more in a sealed benchmark, paired by world; `stratum` and `end` as of `sealed`."""
    one = sealed_entry(name, entry, stratum)
    return one.behind_ci95[end > 0] if end else one.behind


def sealed_worlds(name: str) -> int:
    """Number of worlds of a sealed benchmark."""
    return sealed_summary(name)[1].strata[0].worlds


def sealed_need(name: str) -> int:
    """How many worlds of a sealed benchmark need an action of their own."""
    return len(sealed_summary(name)[1].need)


def stops() -> list[tuple[str, str, str, str]]:
    """(task, arm, time in s, travel in cm) of the table of shipped motions, which a slow test computes again."""
    row = r"^\| (scooping|pushing), (Panda|FR3) \| (0\.\d\d) s \| (\d+) cm \|$"
    return re.findall(row, STOPS.read_text(encoding="utf-8"), re.MULTILINE)


def longest_stop_s() -> float:
    return max(float(time) for _, _, time, _ in stops())


def farthest_stop_cm() -> float:
    return max(float(way) for *_, way in stops())


NAMES: Mapping[str, Any] = {
    **{one.__name__: one for one in (mean, lead, change, gaining, worlds, least, least_world)},
    **{one.__name__: one for one in (longest_stop_s, farthest_stop_cm)},
    **{one.__name__: one for one in (sealed, sealed_lead, sealed_worlds, sealed_need)},
    **{name: value for module in (braking, stopping, watchdog, separation) for name, value in vars(module).items()},
    "default_side_m": PersonPart("left").from_m,
}
"""What an expression may use."""
