"""Rollouts in bulk: run on any Executor, stored as a dataset."""

from sim.rollouts.dataset import Dataset, build_dataset, load_dataset
from sim.rollouts.executors import process_pool, serial_executor, simulating_executor
from sim.rollouts.run import Requests, Rollouts, run_many, run_parts

__all__ = [
    "Dataset",
    "Requests",
    "Rollouts",
    "build_dataset",
    "load_dataset",
    "process_pool",
    "run_many",
    "run_parts",
    "serial_executor",
    "simulating_executor",
]
