"""The cost of a pretraining in words, and a dataset of a slow task that stops growing."""

from __future__ import annotations

import time
from dataclasses import replace

import pytest
from moving_task import TASK, simulate

from sim.research.pretraining.growth import GROWN, enough_rollouts
from sim.rollouts.cost import RolloutCost, duration, measured_cost
from sim.rollouts.executors import serial_executor
from sim.solvers.emulator.training import EmulatorSettings
from sim.storage.files import read_toml

SETTINGS = EmulatorSettings(members=2, hidden=32, layers=2, learning_rate=3e-3, least_steps=150)


def test_the_cost_is_said_in_words():
    assert RolloutCost(5.0).in_words(500, 8) == (
        "a rollout takes 5 s; up to 500 of them on 8 cores take about 5 min, sooner if the error stops falling"
    )
    assert RolloutCost(0.012).in_words(1000, 2) == "a rollout takes 12 ms; up to 1000 of them on 2 cores take about 6 s"
    assert [duration(s) for s in (0.4, 89.0, 600.0, 9000.0)] == ["0.4 s", "89 s", "10 min", "2.5 h"]
    assert measured_cost(TASK, 0).seconds < 0.5


def test_a_task_that_simulates_batches_costs_a_part_of_the_time_of_one():
    sizes = list[int]()

    def in_batches(*rows):
        sizes.append(len(rows[0]))
        time.sleep(0.2)
        return [simulate(*row) for row in zip(*rows, strict=True)]

    cost = measured_cost(replace(TASK, simulate_many=in_batches), 0)
    assert sizes == [64]
    assert cost.seconds < 0.1
    assert RolloutCost(0.01, in_batches=True).in_words(1000, 8) == (
        "a rollout takes 10 ms; up to 1000 of them in batches take about 10 s"
    )


@pytest.mark.long
def test_a_dataset_stops_growing_once_the_error_stops_falling_and_goes_on_after_an_interruption(tmp_path):
    calls: list[int] = []

    def counted(*values):
        calls.append(1)
        return simulate(*values)

    task, shown = replace(TASK, simulate=counted), list[tuple[int, int]]()
    with serial_executor() as executor:
        size = enough_rollouts(task, tmp_path, 8192, 0, SETTINGS, executor, lambda *at: shown.append(at))
        errors = read_toml(tmp_path / GROWN)["errors"]
        first = len(calls)
        again = enough_rollouts(task, tmp_path, 8192, 0, SETTINGS, executor, lambda *at: None)
    assert size == again < 8192
    assert len(calls) == first, "the errors are kept"
    sizes = sorted(map(int, errors))
    assert sizes[-1] == size
    assert errors[str(size)] > 0.95 * errors[str(sizes[-2])]
    assert all(total == 8192 for _, total in shown)
    assert errors[str(sizes[0])] < 0.3, "the error is that of the reward"
