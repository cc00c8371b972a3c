"""Sessions with the Jaco of `jaco.py` by ask and tell: UDR against adaptsim after 8 and 20 trials.

    PYTHONPATH=benchmarks python -m foreign_robot.sessions [--seeds 5] [--pushes 64]

Five sessions of each method. Every policy is scored by the same `--pushes` pushes of this arm, at goals that no session
saw. Prints a row per session, and the means with their 95 % intervals over sessions (Student's t).
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from collections.abc import Callable

import numpy as np
from scipy import stats

from adaptsim_cli import api
from foreign_robot import jaco
from hw.types import Array
from perception.types import ObjectTrack, Outcome
from sim.tasks import get_task

TASK = get_task("pushing")
AFTER = (8, 20)


def judged(policy: Callable[[Array], Array], contexts: Array, friction: float) -> float:
    """The mean reward of the policy at goals (N, 2), with the error that the task's actions have."""
    rng, rewards = np.random.default_rng(77), []
    for context in contexts:
        yaw, speed = policy(context) + rng.uniform(-1.0, 1.0, 2) * TASK.action_noise
        done = jaco.push(float(yaw), float(speed), friction)
        track = ObjectTrack(done.t_s, done.xyz_m, Outcome(done.outcome), np.full(3, np.nan), np.ones(len(done.t_s)))
        rewards.append(TASK.score(track, context))
    return float(np.mean(rewards))


def session(method: str, seed: int, contexts: Array, friction: float) -> list[float]:
    """The rewards after `AFTER` trials; UDR, which learns nothing, after its first four."""
    asked = api.begin("pushing", hw="own", method=method, seed=seed, name=f"{method}-{seed}")
    noise, scores = np.random.default_rng([seed, 5]), list[float]()
    for trials in (4,) if method == "udr" else AFTER:
        while len(asked.trials) < trials:
            trial = asked.ask()
            assert trial.action is not None
            yaw, speed = np.array(list(trial.action.values())) + noise.uniform(-1.0, 1.0, 2) * TASK.action_noise
            done = jaco.push(float(yaw), float(speed), friction)
            asked.tell(trial, done.t_s.tolist(), done.xyz_m.tolist(), done.outcome)
        scores.append(judged(asked.best_policy(), contexts, friction))
    return scores


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--pushes", type=int, default=64)
    parser.add_argument("--friction", type=float, default=jaco.TABLE_FRICTION, help="of the table")
    given = parser.parse_args()
    contexts = TASK.context.sample(np.random.default_rng(2026), given.pushes)
    columns: dict[str, list[float]] = {"UDR": [], **{f"adaptsim, {n} trials": [] for n in AFTER}}
    with tempfile.TemporaryDirectory() as home:
        os.environ["ADAPTSIM_HOME"] = home
        for seed in range(given.seeds):
            began_s = time.monotonic()
            scores = [
                score for method in ("udr", "adaptsim") for score in session(method, seed, contexts, given.friction)
            ]
            for column, score in zip(columns.values(), scores, strict=True):
                column.append(score)
            row = "  ".join(f"{name} {score:.3f}" for name, score in zip(columns, scores, strict=True))
            print(f"seed {seed}: {row}  ({time.monotonic() - began_s:.0f} s)", flush=True)
    for name, values in columns.items():
        error = float(np.std(values, ddof=1) / np.sqrt(len(values))) if len(values) > 1 else float("nan")
        half = float(stats.t.ppf(0.975, len(values) - 1)) * error if len(values) > 1 else float("nan")
        print(f"{name}: {np.mean(values):.3f} ± {half:.3f}, {min(values):.3f} to {max(values):.3f}")


if __name__ == "__main__":
    main()
