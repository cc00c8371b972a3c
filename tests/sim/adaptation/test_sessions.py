"""The loop of every session, played in memory."""

from __future__ import annotations

from itertools import islice
from typing import Any, cast

import numpy as np

from sim.adaptation.adaptation import Adaptation
from sim.adaptation.method import Particle, Trial
from sim.adaptation.sessions import MemorySession, begin_in_memory, iterate
from sim.adaptation.stages import Adapt, RunTrial, Show


class CountingAdaptation:
    """Its particles are the numbers of the iteration; it writes down what it was asked for."""

    def __init__(self) -> None:
        self.trained: list[tuple[float, int]] = []
        self.drawn: list[float] = []

    def start(self, n: int, rng: np.random.Generator) -> tuple[Particle, ...]:
        return tuple(Particle(np.array([[10.0 * k]])) for k in range(n))

    def train(self, particle: Particle, history: Any) -> str:
        self.trained.append((float(particle.mean[0]), len(history)))
        return f"policy of {particle.mean[0]:g}"

    def next(self, history: Any, rng: np.random.Generator) -> tuple[Particle, ...]:
        self.drawn.append(float(rng.random()))
        return tuple(Particle(tried.particle.samples + 1.0) for tried in history[-1])


def session(adaptation: CountingAdaptation, played: list[tuple[str, int, int]]) -> MemorySession:
    def play(policy: Any, iteration: int, particle: int) -> tuple[Trial, ...]:
        played.append((policy, iteration, particle))
        nothing = np.zeros(0)
        return tuple(Trial(nothing, nothing, nothing, float(k), None) for k in range(3))

    rngs = {i: np.random.default_rng(i) for i in range(3)}
    return begin_in_memory(cast(Adaptation, adaptation), play, (2, 3), np.random.default_rng(9), rngs.__getitem__)


def test_every_particle_plays_its_trials_with_a_policy_trained_once_on_what_came_before():
    adaptation, played = CountingAdaptation(), list[tuple[str, int, int]]()
    histories = list(session(adaptation, played).iterations(2))
    assert played == [
        ("policy of 0", 0, 0),
        ("policy of 10", 0, 1),
        ("policy of 1", 1, 0),
        ("policy of 11", 1, 1),
    ]
    assert adaptation.trained == [(0.0, 0), (10.0, 0), (1.0, 1), (11.0, 1)]
    assert [len(history) for history in histories] == [1, 2]
    assert [[t.reward for t in tried.trials] for tried in histories[1][1]] == [[0.0, 1.0, 2.0]] * 2
    assert adaptation.drawn == [np.random.default_rng(i).random() for i in range(2)]


def test_a_session_yields_its_stages_as_they_are_done_and_ends_where_nobody_asks_for_more():
    adaptation, played = CountingAdaptation(), list[tuple[str, int, int]]()
    one = session(adaptation, played)
    stages = [(type(stage), len(played), len(adaptation.drawn)) for stage in islice(iterate(one), 5)]
    assert stages == [(RunTrial, 1, 0), (RunTrial, 2, 0), (Adapt, 2, 1), (Show, 2, 1), (RunTrial, 3, 1)]
    assert one.shown == {0}


def test_an_iteration_counts_as_shown_once_the_next_stage_is_asked_for():
    one = session(CountingAdaptation(), [])
    stages = iterate(one)
    assert isinstance(next(stage for stage in stages if isinstance(stage, Show)), Show)
    assert one.shown == set() and next(iterate(one)) == Show(0), "an end before that yields it again"
    next(stages)
    assert one.shown == {0}
