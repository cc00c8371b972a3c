"""What no simulation parameter expresses (the paper's Figure A4): one action, the world's path among simulated ones.

Pushing, world heavy-bottle, 64 parameters drawn in Omega. Every path is a rollout, so nothing is trained or kept.
"""

from __future__ import annotations

import numpy as np

from hw.types import Array
from sim.lab.rollouts import rollouts_in
from sim.lab.world import load_world
from sim.tasks import get_task
from studies.shared import Asked, plot, save, table

WORLDS, DRAWS, ACTIONS = ("wd", "heavy-bottle", "half-full"), 64, 3
TIMES_S: Array = np.linspace(0.0, 1.3, 53)


def run(asked: Asked) -> None:
    """Simulate, print how far the world's path leaves the simulated ones, draw."""
    task, rng = get_task("pushing"), np.random.default_rng(0)
    parameters, nuisance = task.parameters.sample(rng, DRAWS), task.nuisance.sample(rng, DRAWS)
    actions, context = task.action.sample(np.random.default_rng(1), ACTIONS), task.reference_context
    body, paths = [], []
    for k, action in enumerate(actions):
        simulated = np.stack(
            [task.simulate(e, context, action, n).at(TIMES_S)[:, :2] for e, n in zip(parameters, nuisance, strict=True)]
        )
        for name in WORLDS:
            world = load_world(name, task)
            real = rollouts_in(world)(world.parameters, context, action, world.nuisance).at(TIMES_S)[:, :2]
            gap_mm = 1e3 * np.linalg.norm(simulated - real, axis=-1)  # (draws, times)
            outside = ((real < simulated.min(axis=0)) | (real > simulated.max(axis=0))).any(axis=-1)
            whole = gap_mm.max(axis=1).min()
            body.append([name, str(k + 1), f"{outside.mean():.0%}", f"{whole:.1f}", f"{gap_mm[:, -1].min():.1f}"])
            paths.append((name, k, simulated, real))
    head = [
        "world",
        "action",
        "of its time outside of all simulated paths",
        "nearest whole path, mm at most",
        "nearest end, mm",
    ]
    print(table(head, body))
    plt = plot()
    figure, grid = plt.subplots(
        ACTIONS, len(WORLDS), figsize=(8.4, 6.0), sharex=True, sharey="row", layout="constrained"
    )
    for name, k, simulated, real in paths:
        axes = grid[k, WORLDS.index(name)]
        axes.plot(*np.moveaxis(simulated, -1, 0).swapaxes(1, 2), color="#2a8f5a", alpha=0.25, lw=0.7)
        axes.plot(*real.T, color="#c0202c", lw=1.6)
        axes.set_title(f"{name}, action {k + 1}", fontsize=8)
    grid[-1, 0].set(xlabel="x [m]", ylabel="y [m]")
    save(figure, asked)
