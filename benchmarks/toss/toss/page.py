"""The page of the results: rewards of the methods on tosses that other people recorded."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from sim.rollouts.recorded import RecordedTrials
from sim.solvers.grid import GridSolver
from sim.storage.files import whole_file
from toss import NEAR_M, TASK
from toss.data import Tosses
from toss.strip import draw

RESAMPLED = 10_000
SHOWN = 3
"""Tosses of the film strip."""

REFERENCES = {
    "udr": "UDR: one policy for all parameters",
    "average_particle": "one guess of the parameters (mean over the grid)",
    "authors": "the authors' friction, 0.15, the rest unknown",
    "best_of_grid": "best point of the grid, chosen by all shown tosses",
    "best_recorded": "best held-out toss in hindsight",
}

TEMPLATE = Path(__file__).with_name("page.txt")


def write(
    rows: Sequence[dict[str, Any]],
    methods: Sequence[str],
    tosses: Tosses,
    held: Sequence[int],
    grid: GridSolver,
    path: Path,
) -> None:
    """Write the page, and `figures/tosses.jpg` beside its folder. `held`: rows of the tosses that seed 0 held out."""
    known = {**REFERENCES, **{name: f"`{name}`, 20 tosses" for name in methods}}
    order = ("udr", *methods, "average_particle", "authors", "best_of_grid", "best_recorded")
    table = "\n".join(f"| {known[n]} | {_mean(rows, n)} | {_gain(rows, n) if n != 'udr' else ''} |" for n in order)
    posterior = np.mean([row["posterior"] for row in rows], axis=0)
    values = TASK.parameters.denormalise(posterior)
    named = [f"{d.plain} {v:.3g} {d.unit}".rstrip() for d, v in zip(TASK.parameters.dimensions, values, strict=True)]
    share = 100.0 * float(np.mean([row["inexpressible"] for row in rows]))
    text = TEMPLATE.read_text(encoding="utf-8").format(
        near_mm=1e3 * NEAR_M,
        tosses=len(tosses.trials),
        points=len(grid.points),
        seeds=len(rows),
        table=table,
        conclusion=_conclusion(rows, methods),
        guess=_gain(rows, "average_particle"),
        permuted=_mean(rows, "permuted"),
        permuted_shown=_mean(rows, "permuted_shown"),
        posterior=", ".join(named),
        inexpressible=share,
        strange=float(np.mean([row["strange"] for row in rows])),
        **_expressed(grid, tosses.trials),
        **{
            f"{name}_{what}": f"{factor * float(np.mean([row[f'{name}_{key}'] for row in rows])):.0f}"
            for name in ("prior", "posterior")
            for what, key, factor in (("error", "error_mm", 1.0), ("face", "face", 100.0))
        },
    )
    figure = path.parent.parent / "figures" / "tosses.jpg"
    figure.parent.mkdir(parents=True, exist_ok=True)
    middle = TASK.parameters.middle
    first = TASK.parameters.denormalise(np.array(rows[0]["posterior"]))
    draw(tosses, held[:SHOWN], (("prior", middle), ("posterior", first)), figure)
    path.parent.mkdir(parents=True, exist_ok=True)
    with whole_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _conclusion(rows: Sequence[dict[str, Any]], methods: Sequence[str]) -> str:
    """`adaptsim` against UDR, and against the best of the other methods."""
    low, high = interval([row["adaptsim"] - row["udr"] for row in rows])
    told = "`adaptsim` does **not** clearly beat UDR here: the interval of its gain holds zero."
    if low > 0.0:
        told = "`adaptsim` earns more than UDR on real tosses that it never saw."
    elif high < 0.0:
        told = "`adaptsim` earns **less** than UDR here: adapting to these tosses does harm."
    others = [name for name in methods if name != "adaptsim"]
    if not others:
        return told
    best = max(others, key=lambda name: float(np.mean([row[name] for row in rows])))
    return f"{told} The best other method is `{best}`; the paired difference to it is {_gain(rows, 'adaptsim', best)}."


def _expressed(grid: GridSolver, tosses: RecordedTrials) -> dict[str, str]:
    """The error of the simulated ends with each toss's own best point and with the best point of all, and the distance
    between the ends of neighbouring points.
    """
    ends = grid.outcomes(grid.points[None], tosses.actions[:, None], np.zeros(0), grid.contexts[:1]).end_state
    real = np.stack([track.state[-1, :2] for track in tosses.tracks])
    off_m = np.linalg.norm(ends[0, ..., :2] - real[:, None], axis=-1)
    unit = TASK.parameters.normalise(grid.points)
    _, near = cKDTree(unit).query(unit, k=2)
    apart_m = np.linalg.norm(ends[0, ..., :2] - ends[0][:, near[:, 1], :2], axis=-1)
    medians_m = {
        "own": np.median(off_m.min(axis=1)),
        "joint": np.median(off_m, axis=0).min(),
        "apart": np.median(apart_m),
    }
    right = (
        "So it is right to say nothing, because these tosses cannot distinguish a wrong simulator from a coarse grid."
    )
    wrong = (
        "So it is **wrong** to say nothing, because neighbouring points differ by less than the error of the best one."
    )
    values = {f"{name}_mm": f"{1e3 * value:.0f}" for name, value in medians_m.items()}
    return values | {"right": right if medians_m["joint"] <= medians_m["apart"] else wrong}


def _mean(rows: Sequence[dict[str, Any]], name: str) -> str:
    values = [row[name] for row in rows]
    low, high = interval(values)
    return f"{np.mean(values):.3f} ({low:.3f} to {high:.3f})"


def _gain(rows: Sequence[dict[str, Any]], name: str, other: str = "udr") -> str:
    values = [row[name] - row[other] for row in rows]
    low, high = interval(values)
    return f"{np.mean(values):+.3f} ({low:+.3f} to {high:+.3f})"


def interval(values: Sequence[float]) -> tuple[float, float]:
    """95 % interval of the mean, by bootstrap."""
    drawn = np.random.default_rng(0).integers(len(values), size=(RESAMPLED, len(values)))
    low, high = np.quantile(np.asarray(values)[drawn].mean(axis=1), [0.025, 0.975])
    return float(low), float(high)
