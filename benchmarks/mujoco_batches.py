"""What MuJoCo's own batches would gain: the puck of the guide's `glide.py`, by `adaptsim.run_mujoco` and by
`mujoco.rollout`.

    python benchmarks/mujoco_batches.py FOLDER [--rollouts 40]        # with glide.py and scene.xml of the page

Prints the CPU time of a rollout of either kind, and the largest difference of their ends. `mujoco.rollout` plays
controls that are known beforehand; `run_mujoco` calls the task's functions in every step.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from types import SimpleNamespace

import mujoco
import numpy as np
from mujoco import rollout

import adaptsim
from sim.tasks import task_of_file

PUSHED_S = 0.2
"""How long `glide.py` pushes the puck."""


def main() -> None:
    """Print both times."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--rollouts", type=int, default=40)
    asked = parser.parse_args()
    task = task_of_file(str(asked.folder / "glide.py"))
    rng, n = np.random.default_rng(0), asked.rollouts
    parameters, actions = task.parameters.sample(rng, n), task.action.sample(rng, n)
    nothing, context = np.zeros(0), task.context.middle
    task.simulate(parameters[0], context, actions[0], nothing)  # imports
    began = time.process_time()
    tracks = [task.simulate(p, context, a, nothing) for p, a in zip(parameters, actions, strict=True)]
    step_by_step = time.process_time() - began

    scene = adaptsim.mjcf(
        str((asked.folder / "scene.xml").absolute()),
        {"mu": "geom/table/friction[0]", "mass": "geom/disc/mass"},
    )
    began = time.process_time()
    models = [scene(SimpleNamespace(mu=mu, mass=mass)) for mu, mass in parameters]
    data, step_s = mujoco.MjData(models[0]), models[0].opt.timestep
    steps = round(float(task.observation.times_s[-1]) / step_s)
    whole = mujoco.mjtState.mjSTATE_FULLPHYSICS
    state = np.zeros(mujoco.mj_stateSize(models[0], whole))
    mujoco.mj_getState(models[0], data, state, whole)
    forces = np.zeros((n, steps, models[0].nbody, 6))
    pushed = np.arange(steps) * step_s < PUSHED_S
    forces[:, :, models[0].body("puck").id, 0] = np.where(pushed, actions, 0.0)
    states, _ = rollout.rollout(
        models,
        data,
        np.tile(state, (n, 1)),
        forces.reshape(n, steps, -1),
        control_spec=int(mujoco.mjtState.mjSTATE_XFRC_APPLIED),
    )
    batch = time.process_time() - began
    off = max(abs(float(one.state[-1, 0]) - float(x)) for one, x in zip(tracks, states[:, -1, 1], strict=True))
    print(f"run_mujoco {1e3 * step_by_step / n:.1f} ms, mujoco.rollout {1e3 * batch / n:.1f} ms per rollout")
    print(f"ratio {step_by_step / batch:.1f}; the ends differ by up to {off:.2g} m")


if __name__ == "__main__":
    main()
