"""The learning gate tells whether an adaptation policy uses what it sees."""

from typing import cast

import numpy as np
import pytest
from toy_learning import trained
from toy_task import TOY

from sim.research.methods.q_network import QNetwork
from sim.research.pretraining.episodes import EmulatedRolls, Simulator, Solved
from sim.research.pretraining.meta_training import learning_gate
from sim.solvers.solver import SolverSettings


class Choosing:
    """Stands for a network: moves by a rule."""

    def __init__(self, rule):
        self.directions = rule


def informed(state):
    """The piece's way back and its drift aside tell of mu and h; that is what this reads off, roughly."""
    unit, seen = state[:, :4], TOY.observation.denormalise(state[:, 4 : 4 + TOY.observation.size])
    moved = seen[:, -1, 0] - seen[:, 0, 0]
    expected = 0.05 + 0.1 * (0.25 + 0.4 * unit[:, 3])
    mu = np.clip(unit[:, 0] + (expected - moved) / 0.2, 0.0, 1.0)
    step = np.zeros_like(unit, dtype=int)
    step[:, 0] = np.where(np.abs(mu - unit[:, 0]) > 0.08, np.sign(mu - unit[:, 0]), 0)
    return step


def drifting(state):
    return np.tile([1, 0, 0, -1], (len(state), 1))


def gate(rule):
    emulator = trained()[0]
    solver = emulator
    acting = Solved(solver, SolverSettings(candidates=64, scenarios=4))
    simulator = Simulator(solver, acting, EmulatedRolls(emulator, np.random.default_rng(0)))
    return learning_gate(simulator, cast("QNetwork", Choosing(rule)), "iteration", 0, count=48)


@pytest.mark.long
def test_the_gate_passes_who_moves_by_what_it_sees_and_stops_who_drifts():
    good, idle = gate(informed), gate(drifting)
    assert good.passed
    assert good.policy > max(good.stay, good.drift) + 0.02
    assert good.above_ci95[0] < good.policy - max(good.stay, good.drift) < good.above_ci95[1]
    assert not idle.passed
    assert idle.policy == idle.drift
