"""Runs of a real double pendulum predicted: python -m swing.experiment FOLDER [--page PAGE].

FOLDER has the identification runs of DFKI's design C.1 (docs/results/double-pendulum.md), one NPZ file per run. Each is
cut into windows of one second; twenty windows, drawn by the seed, update the simulation parameters, and the others are
predicted. The last line is one JSON object.
"""

from __future__ import annotations

import argparse
import json
import zipfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hw.types import Array
from sim.adaptation.method import Iteration, Particle, ParticleTrials, Trial
from sim.adaptation.methods.belief import AdaptSimBelief
from sim.adaptation.reward_table import RewardTable
from sim.rollouts.draws import cover
from sim.rollouts.recorded import RecordedTrials
from sim.rollouts.run import observed
from sim.solvers.grid import PROBES, GridSolver
from sim.storage.files import whole_file
from swing import LENGTH_M, NODE_S, NODES, PARAMETERS, TASK, VISCOUS_N_M_S, integrate, track_of

POINTS, FITTED, SEEDS = 2048, 20, 20
START_S = 0.02
"""Readings this near to the start of a window give its angles and speeds, by a parabola."""

MOST_RAD = 2.0
"""Runs that go beyond swing up: for one second there is no predicting."""

TEMPLATE = Path(__file__).with_name("page.txt")


def published(m1: float, r1: float, i1: float, m2: float, r2: float, i2: float, ir: float, friction: Array) -> Array:
    """(8,) for `swing.integrate` of parameters as DFKI names them; `friction` is cf1, cf2, b1, b2."""
    gear = 6.0
    inner = i1 + m2 * LENGTH_M**2 + (gear**2 + 1.0) * ir
    scale = np.array([np.pi / 2.0, np.pi / 2.0, 1.0, 1.0])  # theirs multiplies an arc tangent
    lumped = [inner, (i2 + gear**2 * ir) / (m2 * r2), m1 * r1 + m2 * LENGTH_M, m2 * r2]
    return np.concatenate([lumped, scale * friction])


MODELS = {
    "by_hand": published(
        0.52346, 0.2, 0.0318872, 0.6255677, 0.2556931, 0.0508698, 6.2872e-5, np.array([0.16, 0.12, 0.001, 0.001])
    ),
    "identified": published(
        0.7586436, 0.2, 0.0421116, 0.3369369, 0.468438, 0.0510353, 6.2872e-5,
        np.array([0.1746719, 0.11, 0.0036909, 0.0006451]),
    ),
}  # fmt: skip
"""Their models 1.0 and 2.0 of design C.1 (data/system_identification/identified_parameters)."""


def read_windows(folder: Path) -> RecordedTrials:
    """Windows of one second of all runs. Raises ValueError naming the defect of a file, or that there are too few."""
    names, actions, tracks = list[str](), list[Array](), []
    for path in sorted(folder.glob("*.npz")):
        try:
            with np.load(path, allow_pickle=False) as file:
                t_s, *columns = (np.asarray(file[name], dtype=np.float64) for name in ("time", *_COLUMNS))
        except (OSError, KeyError, ValueError, zipfile.BadZipFile) as error:
            raise ValueError(f"{path} is not a run (arrays time, {', '.join(_COLUMNS)}): {error}") from error
        if (
            len({len(t_s), *map(len, columns)}) > 1
            or not np.isfinite([t_s, *columns]).all()
            or (np.diff(t_s) < 0).any()
        ):
            raise ValueError(f"{path}: its arrays must be finite, equally long, and its times must not decrease")
        if max(np.abs(columns[k]).max() for k in (0, 1)) > MOST_RAD:
            continue
        for number in range(int(t_s[-1] - t_s[0] - START_S)):
            begin_s = t_s[0] + number
            near, nodes = np.abs(t_s - begin_s) <= START_S, begin_s + NODE_S * np.arange(NODES)
            q1, q2, tau1, tau2 = (np.interp(nodes, t_s, column) for column in columns)
            (_, v1, at1), (_, v2, at2) = (np.polyfit(t_s[near] - begin_s, c[near], 2) for c in columns[:2])
            rates = np.gradient(np.stack([q1, q2], axis=1), NODE_S, axis=0)
            names.append(f"{path.stem}/{number}")
            actions.append(np.concatenate([[at1, at2, v1, v2], np.stack([tau1, tau2], axis=1).ravel()]))
            tracks.append(track_of(np.concatenate([np.stack([q1, q2], axis=1), rates], axis=1)))
    if len(names) <= FITTED:
        raise ValueError(f"{folder} holds {len(names)} windows of one second, and more than {FITTED} are needed")
    return RecordedTrials(TASK, tuple(names), None, np.array(actions), tuple(tracks))


_COLUMNS = ("pos_meas1", "pos_meas2", "tau_meas1", "tau_meas2")


def angles(parameters: Array, trials: RecordedTrials) -> Array:
    """(W, K, NODES, 2) predicted angles of every window for parameters (K, 8)."""
    torques = trials.actions[:, 4:].reshape(len(trials), NODES, 2)
    return np.stack([integrate(parameters, a[:4], u)[..., :2] for a, u in zip(trials.actions, torques, strict=True)])


def fitted(grid: GridSolver, trials: RecordedTrials, rows: NDArray[np.int_]) -> Array:
    """(K,) probabilities of the grid's points after these trials."""
    history = tuple(
        Trial(np.zeros(1), trials.actions[i], TASK.observation(trials.tracks[i]), 0.0, TASK.end_of(trials.tracks[i]))
        for i in rows
    )
    table = RewardTable(grid.points, grid.points, np.zeros((1, len(grid.points))))
    tried: Iteration = (ParticleTrials(Particle(grid.points[:1]), history),)
    return AdaptSimBelief(grid, table).weights([tried])


def errors(trials: RecordedTrials) -> tuple[dict[str, list[float]], Array]:
    """RMS errors in rad of the windows not fitted, by name and seed; and the mean parameters of the first seed."""
    points, context = cover(PARAMETERS, POINTS, np.random.default_rng(0)), np.tile(TASK.reference_context, (POINTS, 1))
    grid = GridSolver(TASK, points, context, trials.actions[:PROBES], np.zeros((1, 0)))
    models = {**MODELS, "no_friction": MODELS["identified"] * (np.arange(8) < 4)}
    whole = np.concatenate([grid.points, np.tile(VISCOUS_N_M_S, (POINTS, 1))], axis=1)
    paths = angles(np.concatenate([whole, list(models.values())]), trials)
    predicted, known = paths[:, :POINTS], dict(zip(models, np.moveaxis(paths[:, POINTS:], 1, 0), strict=True))
    real = np.stack([track.state[:, :2] for track in trials.tracks])
    for action, ways in zip(trials.actions, predicted, strict=True):
        states = np.concatenate([ways, np.zeros_like(ways)], axis=-1)
        grid.remember(action, np.zeros(0), observed(TASK, [track_of(state) for state in states]))
    found: dict[str, list[float]] = {name: [] for name in ("prior", "posterior", *known)}
    for seed in range(SEEDS):
        order = np.random.default_rng(seed).permutation(len(trials))
        rest, weights = order[FITTED:], fitted(grid, trials, order[:FITTED])
        means = {"prior": predicted.mean(axis=1), "posterior": np.einsum("k,wknq->wnq", weights, predicted), **known}
        for name, path in means.items():
            found[name].append(float(np.sqrt(((path[rest] - real[rest]) ** 2).mean())))
    first = fitted(grid, trials, np.random.default_rng(0).permutation(len(trials))[:FITTED])
    return found, np.asarray(first @ grid.points)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", type=Path, help="folder of the runs")
    parser.add_argument("--page", type=Path, help="write the page of the results here")
    asked = parser.parse_args()
    try:
        trials = read_windows(asked.runs)
    except ValueError as error:
        parser.error(str(error))
    found, mean = errors(trials)
    if asked.page is not None:
        low_high = {name: np.quantile(values, [0.0, 1.0]) for name, values in found.items()}
        cells = {n: f"{np.mean(v):.3f} | {low_high[n][0]:.3f} to {low_high[n][1]:.3f}" for n, v in found.items()}
        estimate = ", ".join(f"{d.plain} {v:.3g} {d.unit}" for d, v in zip(PARAMETERS.dimensions, mean, strict=True))
        with whole_file(asked.page) as temporary:
            text = TEMPLATE.read_text(encoding="utf-8")
            sizes = {"windows": len(trials), "fitted": FITTED, "others": len(trials) - FITTED}
            filled = text.format(**cells, **sizes, seeds=SEEDS, points=f"{POINTS:,}", estimate=estimate)
            temporary.write_text(filled, encoding="utf-8")
    print(json.dumps({name: round(float(np.mean(values)), 4) for name, values in found.items()}))


if __name__ == "__main__":
    main()
