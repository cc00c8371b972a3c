"""How near the dataset of a slow simulator comes to the ideal of its processes.

A simulator that sleeps stands for a slow one. 500 rollouts of 5 s on 8 processes take at least 312.5 s; here each takes
a tenth of that, and starting the processes counts too.

    python benchmarks/slow_rollouts.py            # 500 rollouts of 0.5 s on 8 processes
"""

from __future__ import annotations

import argparse
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from hw.types import Array
from perception.types import ObjectTrack
from sim.rollouts.dataset import build_dataset
from sim.rollouts.executors import process_pool
from sim.tasks.pendulum import TASK as PENDULUM


class Sleeping:
    """`Task.simulate`, delayed."""

    def __init__(self, seconds: float) -> None:
        self.seconds = seconds

    def __call__(
        self, parameters: Array, context: Array, action: Array, nuisance: Array, unmodelled: Any = None
    ) -> ObjectTrack:
        time.sleep(self.seconds)
        return PENDULUM.simulate(parameters, context, action, nuisance, unmodelled)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rollouts", type=int, default=500)
    parser.add_argument("--seconds", type=float, default=0.5)
    parser.add_argument("--processes", type=int, default=8)
    asked = parser.parse_args()
    task = replace(PENDULUM, simulate=Sleeping(asked.seconds), simulate_many=None)
    began = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder, process_pool(asked.processes) as crew:
        dataset = build_dataset(task, Path(folder), asked.rollouts, 0, crew)
    took, ideal = time.perf_counter() - began, asked.rollouts * asked.seconds / asked.processes
    print(f"{len(dataset)} rollouts in {took:.1f} s; ideal {ideal:.1f} s; ratio {took / ideal:.2f} (limit 1.2)")
    assert np.isfinite(dataset.rollouts.observation).all()


if __name__ == "__main__":
    main()
