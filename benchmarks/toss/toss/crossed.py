"""Why methods earn differently on recorded tosses, by their choice of tosses or by their conclusions: python -m
toss.crossed TOSSES.

A session chooses tosses, then a final policy. Each method draws conclusions from its own tosses and from those of the
other, which separates the two parts. `adaptsim` also concludes without its caution (the surer of two equal actions),
and as if its grid had no error (`Simulators.is_grid`). Simulations are those of `toss.experiment`, in the same folder
`--out`. Stop it at any time: the same command continues. The last line is one JSON object.
"""

from __future__ import annotations

import argparse
import json
from contextlib import AbstractContextManager
from functools import partial
from pathlib import Path
from unittest.mock import patch

import numpy as np

from sim.adaptation.method import Iteration
from sim.adaptation.methods.adaptsim import AdaptSim
from sim.adaptation.outcome_posterior import OutcomePosterior, PosteriorPolicy
from sim.adaptation.simulators import Simulators
from toss.experiment import HELD_OUT, METHODS, SEEDS, Split, prepared, stored
from toss.page import interval

CHOSEN_BY = ("adaptsim", "sysid-bayes")
"""The methods that choose tosses, and that conclude from them."""


def crossed(split: Split) -> dict[str, float]:
    """The rewards of final policies, by the method that chose the tosses and the way to conclude from them; and the
    effective number of the grid's points in the posterior of `adaptsim`.
    """
    results = dict[str, float]()
    for chooser in CHOSEN_BY:
        history = split.history(METHODS[chooser](split.session))
        for name in CHOSEN_BY:
            results[f"{chooser} > {name}"] = split.final(name, history)
        known = _posterior(split, history)
        results[f"{chooser} > without caution"] = split.scored(PosteriorPolicy(known, 0.0, None))
        results[f"{chooser}: points"] = _effective(known)
        with _without_the_grids_error():
            results[f"{chooser} > without the grid's error"] = split.final("adaptsim", history)
            results[f"{chooser}: points without the grid's error"] = _effective(_posterior(split, history))
    with _without_the_grids_error():
        history = split.history(METHODS["adaptsim"](split.session))
        results["without the grid's error > itself"] = split.final("adaptsim", history)
    return results


def _without_the_grids_error() -> AbstractContextManager[object]:
    return patch.object(Simulators, "is_grid", False)


def _effective(known: OutcomePosterior) -> float:
    return float(1.0 / np.sum(known.weights**2))


def _posterior(split: Split, history: tuple[Iteration, ...]) -> OutcomePosterior:
    method = METHODS["adaptsim"](split.scores)
    assert isinstance(method, AdaptSim)
    return method.outcome_posterior(history)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tosses", type=Path, help="tosses.npz")
    parser.add_argument("--out", type=Path, default=Path("build/tosses"), help="folder of the results")
    parser.add_argument("--seeds", type=int, default=SEEDS)
    asked = parser.parse_args()
    try:
        tosses, grid, folder = prepared(asked.tosses, asked.out)
    except ValueError as error:
        parser.error(str(error))
    rows = list[dict[str, float]]()
    for seed in range(asked.seeds):
        split = Split.of(grid, tosses.trials.split(HELD_OUT, seed), seed)
        rows.append(stored(folder / f"crossed-{seed:04d}.json", partial(crossed, split)))
    reference = "sysid-bayes > sysid-bayes"
    means = {name: round(float(np.mean([row[name] for row in rows])), 4) for name in rows[0]}
    ways = [name for name in means if ">" in name and name != reference]
    apart = {name: [row[name] - row[reference] for row in rows] for name in ways}
    leads = {name: [round(v, 4) for v in (float(np.mean(d)), *interval(d))] for name, d in apart.items()}
    print(json.dumps({"seeds": len(rows), "means": means, f"minus {reference}": leads}))


if __name__ == "__main__":
    main()
