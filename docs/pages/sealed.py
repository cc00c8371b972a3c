"""The pages of the sealed benchmark, and of what there is to adapt: written from stored results alone."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator, Sequence
from functools import cache
from typing import Any

import numpy as np

from pages import ROOT
from sim.research.benchmark.jobs import BenchmarkRow
from sim.research.benchmark.strata import ALL, NEED, STRATA, SealedSummary, StratumSummary, by_strata

RESULTS = ROOT / "docs/results"
STORED, OWN, SESSIONS = RESULTS / "sealed", RESULTS / "own-actions.json", RESULTS / "sessions.csv"

WHOSE = {
    "adaptsim": "this program (default)",
    "adaptsim@omega": "ablation: without the margin",
    "adaptsim-no-weights": "ablation: without weights",
    "adaptsim-no-discrepancy": "ablation: without discrepancy",
    "adaptsim-no-free-actions": "ablation: only actions of some E",
    "adaptsim-iteration": "paper: its adaptation policy, our training",
    "best-action": "limit",
    "best-of-first": "fixed rules, the best kept",
    "bo-prior": "ours; prior over the margin",
    "first-action": "fixed rule, no trial",
    "second-action": "fixed rule, no trial",
    "learn-in-target": "paper, with a Gaussian process",
    "least-squares": "textbook; told the margin",
    "least-squares@omega": "textbook; told Ω",
    "oracle": "limit: best E of Ω",
    "oracle@margin": "limit: best E of the margin",
    "random": "ours; E of Ω",
    "random@margin": "ours; E of the margin",
    "simopt": "Chebotar et al. 2019; told Ω",
    "simopt@margin": "Chebotar et al. 2019; told the margin",
    "sysid-bayes": "paper (BayesSim); told Ω",
    "sysid-bayes@margin": "paper (BayesSim); told the margin",
    "udr": "paper; fixed rule, no trial",
    "udr-mean": "fixed rule: best mean over Ω",
}

FEWEST = 4
"""Fewer worlds have no interval on the page: with two, it would be wider than all possible rewards."""

SEALED_HEAD = """# Sealed benchmark

The worlds come from a random seed that nobody chose. They were opened once, after the code was frozen ([rules](../reference/benchmark.md#sealed-worlds)). `make docs` writes this page from `docs/results/sealed/`.

*Reward* is the mean reward of the final policy over the worlds, with its 95 % interval (Student's t). *`adaptsim` minus it* is paired by world. A world is *in need* if its best action earns at least 0.1 more than the best fixed rule. Entries use one training seed, unless the heading names several.
"""

OWN_HEAD = """# What there is to adapt

A session can gain at most the *worth* of an own action for each world: the reward of the best action for that world, minus that of the best fixed rule, which needs no trial. This page gives the worth. `make docs` writes it from `docs/results/own-actions.json` (`python benchmarks/own_actions.py`), `docs/results/sessions.csv` and the [sealed benchmark](sealed.md).

## By the simulator

The table compares 128 true parameter vectors in Ω, and 128 in the margin beyond it. The fixed rule has one action for each context; it is chosen with one half of the truths and scored with the other. In the contact tasks the emulator predicts the rewards, so the best of 384 actions is a little too high.

| | best fixed rule | own action | worth | truths in need |
| --- | --- | --- | --- | --- |
"""

SETS = {
    "pendulum": "pendulum, 40 drawn worlds",
    "pushing": "pushing, 40 drawn worlds",
    "scooping": "scooping, 40 drawn worlds",
    "foods-drawn": "scooping, 40 drawn foods",
}

SEALED_SETS = ("pendulum-drawn", "pushing-drawn")
"""The stored sealed benchmarks that name the worth of an own action."""

PLACES = {"omega": "in Ω", "beyond": "in the margin beyond Ω"}

OWN_TAIL = """
## What follows

* **Pushing** is the task that needs adapting: about a quarter of the truths and of the drawn worlds need an action of their own, and the best action is only partly known before a trial.
* **The pendulum** needs it in most of Ω, and nearly everywhere beyond. But its simulator is exact, so one trial without noise fixes the parameters, and least squares does as well as `adaptsim`.
* **Scooping** has little to adapt inside Ω and in the drawn worlds. In the drawn foods the worth is large only compared with UDR, whose one action is unlucky there. A fixed pitch rate of 0.04 to 0.08 rad/s earns 0.91 ([one fixed action](../results.md#one-fixed-action-for-all-foods)). The action that the second particle chooses before any trial earned 0.935 in one scoop in each food (0.919 to 0.950), and `adaptsim` earns 0.944 after twenty trials. So there a session quickly finds a good action, but not a different one for each food.

### Why UDR is unlucky in the foods

In training the turner is bevelled to 0.2 mm, but a real one is blunt. In 256 rollouts with a blunt edge (lip 1.1 mm, 3 kN/m, time step 1 ms), spread over the margin and all actions, an early lift is the worst choice. For the same 256 trials the shipped emulator, which knows only the bevelled edge, predicts that it is the best:

| pitch rate, rad/s | rollouts | blunt edge | emulator, bevelled edge | difference |
| --- | --- | --- | --- | --- |
| −0.24 to −0.12 | 64 | 0.50 (± 0.11) | 0.70 | −0.21 (± 0.10) |
| −0.12 to −0.04 | 43 | 0.76 (± 0.10) | 0.65 | +0.11 (± 0.06) |
| −0.04 to 0.04 | 42 | 0.81 (± 0.09) | 0.64 | +0.17 (± 0.08) |
| 0.04 to 0.12 | 43 | 0.70 (± 0.12) | 0.52 | +0.18 (± 0.09) |
| 0.12 to 0.24 | 64 | 0.67 (± 0.10) | 0.51 | +0.16 (± 0.07) |

Intervals are 95 % (1.96 standard errors). The difference grows with the pitch rate by 0.96 (± 0.28) per rad/s, p < 10⁻⁹. So most of UDR's loss in the foods comes from the simplified edge, as an earlier test in Ω had shown. This command makes the table:

    python benchmarks/blunt_edge.py

### A simulator with the blunt edge

We trained the shipped emulator further with this edge: 3,072 rollouts and 800 steps, with `adaptsim object`. For the 256 trials above, 91 % of its outcomes are right (the shipped one: 82 %), and its error no longer depends on the pitch rate (0.05 ± 0.19 per rad/s, p = 0.6). As a control of equal size, we trained it further with 3,072 rollouts of the bevelled edge. All three checkpoints then ran in the same twenty foods, with the same places and draws. These are the opened foods of the [sealed benchmark](sealed.md#scooping-8-trials); their edges differ in height (0.7 to 1.1 mm) and stiffness (1.5 to 5 kN/m). Differences are paired by food, with 95 % intervals (Student's t):

| | bevelled edge (`default`) | control: more rollouts of it | blunt edge (`blunt-edge`) | blunt minus `default` | blunt minus control |
| --- | --- | --- | --- | --- | --- |
| `udr`, without a trial | 0.743 | 0.772 | 0.895 | +0.152 (+0.005 to +0.299) | +0.123 (−0.022 to +0.268) |
| `second-action`, without a trial | 0.899 | | 0.902 | +0.003 (−0.005 to +0.011) | |
| `adaptsim`, eight trials | 0.898 | 0.897 | 0.952 | +0.053 (−0.051 to +0.158) | +0.055 (−0.050 to +0.159) |
| `adaptsim` minus `udr` | +0.156 (−0.011 to +0.322) | +0.125 (−0.036 to +0.287) | +0.057 (−0.002 to +0.116) | | |

* **With the blunt edge, UDR earns more than 0.85 in these foods.** It ends below 0.6 in one of the twenty foods, instead of in four with either other checkpoint. Its gain over `default` is shown. Its gain over the control is smaller by 0.029 and is not shown: in one food the blunt edge makes UDR worse (0.21 instead of 0.83).
* **`adaptsim` does not lose**: it ends with 0.77 or more in every food. The food that ended with 0.00 ends with 0.99, and still with 0.00 in the control. So it is the edge that mends it, because the emulator no longer prefers an early lift. A lead over UDR is not shown.
* **The training hardly matters.** Two further trainings of the networks on the same rollouts give UDR 0.901 and 0.897 with the blunt edge, and `adaptsim` 0.954 and 0.950. Two further ones of the control give UDR 0.749 and 0.748. The means over three trainings differ by +0.141 (−0.004 to +0.286), so the doubt that remains comes from the choice of foods.
* **In twenty fresh foods** (seed 554199971, rule `foods`, drawn after these three checkpoints were made, none left out) the gain of UDR is shown. It earns 0.899 with the blunt edge, 0.763 with `default` (+0.136, +0.012 to +0.260) and 0.765 with the control (+0.134, +0.014 to +0.255). `adaptsim` with eight trials earns 0.892 with the blunt edge and 0.854 with `default` (+0.038, −0.039 to +0.115), so with the blunt edge it earns no more than UDR (−0.007, −0.069 to +0.054). One food ends with 0.00. With `default`, the action of the second particle earns 0.906 without a trial (`adaptsim` minus it: −0.052, −0.120 to +0.015).
* **In the six foods of the paper** UDR earns 0.896 instead of 0.568 (+0.328, +0.005 to +0.651), and `adaptsim` 0.936 instead of 0.901 (+0.035, −0.046 to +0.117). In `cucumber`, the world of `make demo`, UDR earns 0.94 instead of 0.32.
* **Where the edge is bevelled, the checkpoint costs little.** We drew worlds with a new seed, 554199971, and took the first twenty with a bevelled edge. There UDR earns 0.763 with the blunt edge in the simulator and 0.757 with `default` (+0.006, −0.027 to +0.038), and `adaptsim` with eight trials 0.764 and 0.800 (−0.035, −0.083 to +0.012). Most of the latter is one world, in which it ends with 0.00 instead of 0.42.
* **The checkpoint ships as `blunt-edge`.** `--object blunt-edge` [uses it](../guide/own-objects.md#a-turner-with-a-blunt-edge), and we recommend it for a real turner. It is not the default: the paper's policies are not trained for it, and all other results were measured with the bevelled edge.

These commands make the table:

    python benchmarks/blunt_edge.py --trained sim/checkpoints/scooping/blunt-edge
    adaptsim world-tables --task scooping --targets foods-720120299-0,foods-720120299-1 --rollouts 16
    adaptsim benchmark --task scooping --object blunt-edge --targets foods-720120299-0,foods-720120299-1 --budget 8 --seeds 1 --fresh 8 --methods udr,second-action,adaptsim
    adaptsim object bevelled --task scooping --effect density_scale=1.0 --rollouts 3072
    python benchmarks/retrain.py DATASET --task scooping --object blunt-edge --seed 1 --out blunt-edge-1

The second and the third command name only the first two foods. Run them for all worlds: foods-720120299-0 to 19, foods-554199971-0 to 19, and raisin, carrot, cucumber, sprout, mushroom-slice and oreo. The worlds with a bevelled edge are `drawn-554199971-N` with N = 0, 3, 6, 8, 9, 10, 11, 13, 15, 20, 22, 24, 25, 26, 27, 29, 31, 32, 33 and 34. Leave `--object` out for `default`. The control is `--object bevelled.toml`, and its effect changes nothing. DATASET is the folder `dataset` that `adaptsim object` leaves in the data folder. The setting `ADAPTSIM_CHECKPOINT=blunt-edge-1` uses a further training. **Not measured:** a training at full size, and one whose edge is drawn at random (but [decision 12](../decisions/0012-edge-foods-and-a-standing-bottle.md) tried a third of the size).
"""


def sealed() -> str:
    """`docs/results/sealed.md`."""
    text = SEALED_HEAD
    for path in sorted(STORED.glob("*.json")):
        text += "\n" + "\n".join(_benchmark(path.stem)) + "\n"
    return text


def own_actions() -> str:
    """`docs/results/what-there-is-to-adapt.md`."""
    text = OWN_HEAD
    for name, one in json.loads(OWN.read_text(encoding="utf-8")).items():
        task, place = name.split()
        worth = one["own"] - one["fixed"]
        text += (
            f"| {task}, {PLACES[place]} | {one['fixed']:.3f} | {one['own']:.3f} | {worth:.3f} | "
            f"{one['in_need']} of {one['truths']} |\n"
        )
    return text + "\n" + "\n".join([*_drawn_sets(), "", *_sealed_worths()]) + "\n" + OWN_TAIL


@cache
def sealed_summary(name: str) -> tuple[dict[str, Any], SealedSummary]:
    """A stored benchmark, such as `pushing-drawn`, and its summary."""
    stored = json.loads((STORED / f"{name}.json").read_text(encoding="utf-8"))
    rows = [
        BenchmarkRow(stored["task"], "sealed", world, entry, seed, reward, (0.0, 1.0), 0, 0, 0.0, ((0, reward),), shown)
        for world, entry, seed, reward, shown in stored["rows"]
    ]
    summary = by_strata(rows)
    assert summary is not None, f"{name} lacks adaptsim or a fixed rule"
    return stored, summary


def sealed_entry(name: str, entry: str, stratum: str = ALL) -> StratumSummary:
    """An entry of a stored benchmark, in all its worlds or in one stratum."""
    _, summary = sealed_summary(name)
    return next(one for one in summary.strata if (one.stratum, one.entry) == (stratum, entry))


def _benchmark(name: str) -> Iterator[str]:
    stored, summary = sealed_summary(name)
    trainings = len(stored["checkpoints"])
    several = f", {trainings} trainings" if trainings > 1 else ""
    yield f"## {stored['task'].capitalize()}, {stored['trials']} trials{several}"
    yield ""
    yield (
        f"Seed {stored['seed']}, rule `{stored['rule']}`, drawn {stored['drawn']}, opened {stored['opened']} by commit "
        f"`{stored['commit'][:8]}`. {stored['note']}"
    )
    yield ""
    yield f"    {stored['command']}"
    yield ""
    yield from _in_short(summary)
    for stratum in STRATA:
        ones = [one for one in summary.strata if one.stratum == stratum]
        if ones and (stratum == ALL or ones[0].worlds < len(summary.worth)):
            yield from _stratum(stratum, ones)


def _in_short(summary: SealedSummary) -> Iterator[str]:
    total = len(summary.worth)
    if total:
        yield (
            f"{len(summary.need)} of {total} worlds are in need. An action of its own is worth "
            f"{_mean_worth(summary):.3f} on average over the best fixed rule, `{summary.fixed_rule}`."
        )
    else:
        yield (
            f"No limit was run, so nobody knows which worlds are in need. The best fixed rule is "
            f"`{summary.fixed_rule}`."
        )
    ones = [one for one in summary.strata if one.stratum == ALL and one.entry != "adaptsim"]
    level = [f"`{one.entry}`" for one in ones if one.behind_ci95[0] <= 0.0 <= one.behind_ci95[1]]
    ahead = [f"`{one.entry}`" for one in ones if one.behind_ci95[1] < 0.0]
    yield f"No difference to `adaptsim` is shown for {', '.join(level) or 'any entry'}."
    others = "It is shown to be ahead of all others." if len(level) + len(ahead) < len(ones) else ""
    yield f"Shown to be ahead of it: {', '.join(ahead) or 'none'}. {others}".rstrip()
    yield ""


def _stratum(stratum: str, ones: Sequence[StratumSummary]) -> Iterator[str]:
    count = ones[0].worlds
    title = {"all": "All worlds", "in need": "Worlds in need", "others": "The other worlds"}[stratum]
    yield f"### {title}: {count}"
    yield ""
    yield "| entry | whose | reward | 95 % | `adaptsim` minus it | 95 % | most in a world |"
    yield "| --- | --- | --- | --- | --- | --- | --- |"
    for one in sorted(ones, key=lambda one: -one.reward):
        interval = _between(one.ci95) if count >= FEWEST else ""
        paired = "" if one.entry == "adaptsim" else _signed(one.behind)
        around = "" if one.entry == "adaptsim" or count < FEWEST else _between(one.behind_ci95, sign=True)
        most = "" if one.entry == "adaptsim" else _signed(one.most_behind)
        yield f"| `{one.entry}` | {WHOSE[one.entry]} | {one.reward:.3f} | {interval} | {paired} | {around} | {most} |"
    yield ""


def _drawn_sets() -> Iterator[str]:
    yield "## In the sets that are reported"
    yield ""
    yield (
        "The limit of a world is the better of its best action and its best E, both chosen by trials that no score "
        "uses. The sessions and UDR are those of [every method](methods.md), from before [decision "
        "18](../decisions/0018-refine-where-the-weight-is.md) changed UDR's choice of actions. "
        f"*In need* means that the limit earns at least {NEED:g} more than UDR."
    )
    yield ""
    yield "| | UDR | limit | worth over UDR | in need | gain of `adaptsim` there | gain in the others |"
    yield "| --- | --- | --- | --- | --- | --- | --- |"
    with SESSIONS.open(encoding="utf-8", newline="") as file:
        lines = list(csv.DictReader(file))
    for part, title in SETS.items():
        rewards: dict[str, dict[str, list[float]]] = {}
        for line in lines:
            if line["part"] == part:
                rewards.setdefault(line["method"], {}).setdefault(line["world"], []).append(float(line["reward"]))
        worlds = sorted(rewards["udr"])
        udr, own, action, oracle = (
            np.array([np.mean(rewards[name][world]) for world in worlds])
            for name in ("udr", "adaptsim", "best-action", "oracle")
        )
        limit = np.maximum(action, oracle)
        need = limit - udr >= NEED
        gain = own - udr
        yield (
            f"| {title} | {udr.mean():.3f} | {limit.mean():.3f} | {(limit - udr).mean():.3f} | {need.sum()} of "
            f"{len(worlds)} | {_signed(gain[need].mean())} | {_signed(gain[~need].mean())} |"
        )


def _sealed_worths() -> Iterator[str]:
    yield "In the [sealed worlds](sealed.md), the worth is that over the best fixed rule:"
    yield ""
    for name in SEALED_SETS:
        stored, summary = sealed_summary(name)
        yield (
            f"* {stored['task']}: {_mean_worth(summary):.3f} with `{summary.fixed_rule}`; {len(summary.need)} of "
            f"{len(summary.worth)} worlds are in need"
        )


def _mean_worth(summary: SealedSummary) -> float:
    return float(np.mean([worth for _, worth in summary.worth]))


def _signed(value: float) -> str:
    return f"{value:+.3f}".replace("-", "−")


def _between(interval: tuple[float, float], *, sign: bool = False) -> str:
    low, high = ((_signed(end) if sign else f"{end:.3f}".replace("-", "−")) for end in interval)
    return f"{low} to {high}"
