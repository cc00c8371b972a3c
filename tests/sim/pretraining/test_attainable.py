"""The paper's policy with a threshold within reach, and the gate that tells whether it learnt anything."""

import functools
from dataclasses import replace

import numpy as np
import pytest
from toy_learning import roll, trained
from toy_task import PARAMETERS, TOY

from sim.adaptation.checkpoint import load_checkpoint, save_checkpoint
from sim.adaptation.memory import MemoryName, new_policy
from sim.adaptation.methods import make_method
from sim.adaptation.methods.q_policy import QPolicy
from sim.adaptation.prospects import ProspectSettings, look_ahead
from sim.adaptation.q_network import QNetwork
from sim.errors import CheckpointError
from sim.pretraining.attainable import attainable_threshold, learning_gate, repair
from sim.solvers.emulator.solver import EmulatorSolver


@functools.cache
def prospects():
    return look_ahead(EmulatorSolver(trained()[0]), 3, ProspectSettings(16, 256, 2))


@pytest.fixture
def stored(tmp_path):
    networks: dict[MemoryName, QNetwork] = {"iteration": new_policy(TOY, "iteration", 5)}
    facts = {"seed": 7, "method": "adaptsim-iteration", "simulations": 99}
    folder = save_checkpoint(TOY, tmp_path / "as-pretrained", trained()[0], networks, facts, prospects())
    return load_checkpoint(TOY, str(folder))


class Choosing:
    """Stands for a network: moves by a rule."""

    def __init__(self, rule):
        self.rule = rule

    def directions(self, state):
        return self.rule(state)


def test_the_threshold_is_what_the_best_parameters_reach_nearly_everywhere(stored):
    threshold = attainable_threshold(stored)
    inside = np.array([PARAMETERS.contains(truth) for truth in prospects().truths])
    best = prospects().rewards[:, inside].max(axis=0)
    assert (best >= min(threshold, 0.5)).mean() >= 0.85
    assert 0.0 < threshold <= TOY.adaptation.threshold
    poor = replace(prospects(), rewards=0.1 * prospects().rewards)
    assert attainable_threshold(replace(stored, prospects=poor)) == pytest.approx(
        round(float(np.quantile(0.1 * best, 0.1)), 3)
    )
    with pytest.raises(CheckpointError, match="holds no prospects"):
        attainable_threshold(replace(stored, prospects=None))


@pytest.mark.long
def test_a_repaired_copy_holds_the_policy_and_its_gate_and_everything_else_as_before(stored, tmp_path):
    told = []
    path, gate = repair(stored, tmp_path / "repaired", 3, 64, lambda *step: told.append(step))
    again = load_checkpoint(TOY, str(path))
    method = make_method("adaptsim-attainable", TOY, again)
    assert isinstance(method, QPolicy)
    assert method.memory == "iteration"
    assert method.network is again.attainable
    learnt, before = again.card.facts(), stored.card.facts()
    added = learnt.pop("attainable")
    assert added["gate"]["policy"] == gate.policy
    assert added["threshold"] == attainable_threshold(stored)
    assert learnt.pop("sha256") != before.pop("sha256")
    assert learnt == before
    states = np.random.default_rng(0).random((8, again.networks["iteration"].inputs))
    assert np.array_equal(
        again.networks["iteration"].directions(states), stored.networks["iteration"].directions(states)
    )
    assert np.array_equal(again.prospects.rewards, stored.prospects.rewards)
    assert {stage for stage, _, _ in told} == {"episodes", "learning", "gate"}
    assert again.sha256 != stored.sha256


def test_without_it_the_message_says_how_to_make_one(stored):
    with pytest.raises(CheckpointError, match="adaptsim checkpoints repair --task toy"):
        make_method("adaptsim-attainable", TOY, stored)


@pytest.mark.long
def test_the_gate_passes_who_moves_by_what_it_sees_and_stops_who_drifts():
    solver = EmulatorSolver(trained()[0])

    def informed(state):
        """The piece's way back and its drift aside tell of mu and h; that is what this reads off, roughly."""
        unit, seen = state[:, :4], TOY.observation.denormalise(state[:, 4 : 4 + TOY.observation.size])
        moved = seen[:, -1, 0] - seen[:, 0, 0]
        expected = 0.05 + 0.1 * (0.25 + 0.4 * unit[:, 3])
        mu = np.clip(unit[:, 0] + (expected - moved) / 0.2, 0.0, 1.0)
        step = np.zeros_like(unit, dtype=int)
        step[:, 0] = np.where(np.abs(mu - unit[:, 0]) > 0.08, np.sign(mu - unit[:, 0]), 0)
        return step

    gates = {
        name: learning_gate(solver, Choosing(rule), roll, 0, count=16)  # type: ignore[arg-type]
        for name, rule in (
            ("informed", informed),
            ("drifting", lambda state: np.tile([1, 0, 0, -1], (len(state), 1))),
        )
    }
    assert gates["informed"].passed
    assert gates["informed"].policy > max(gates["informed"].stay, gates["informed"].drift) + 0.02
    assert not gates["drifting"].passed
    assert gates["drifting"].policy == gates["drifting"].drift
