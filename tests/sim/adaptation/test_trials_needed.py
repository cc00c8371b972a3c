"""How many trials a session needs: counted in imagined worlds, which are what the method holds possible."""

from __future__ import annotations

import functools
from pathlib import Path

import numpy as np
import pytest
from toy_learning import reward_table, trained
from toy_task import TOY

from sim.adaptation.checkpoint import load_checkpoint, save_checkpoint
from sim.adaptation.methods.adaptsim import is_refuted
from sim.adaptation.simulators import Simulators
from sim.adaptation.trials_forecast import FILE, SessionShare, load, save
from sim.adaptation.trials_needed import (
    DIFFERENCES,
    ImaginedWorld,
    _world,
    forecast,
    imagine,
    needed,
    pairs_until_shown,
)
from sim.tasks import TASKS, get_task


@functools.cache
def simulators() -> Simulators:
    return Simulators(trained()[0], reward_table())


def test_imagined_worlds_without_discrepancies_earn_what_the_simulators_predict() -> None:
    rng = np.random.default_rng(0)
    actions, context = TOY.action.sample(rng, 6), TOY.context.sample(rng, 1)
    contexts, truths = np.tile(context, (len(actions), 1)), simulators().truths
    worlds = [ImaginedWorld(simulators(), truth, 0, np.zeros(1 + len(simulators().end_unit))) for truth in truths]
    earned = np.mean([[trial.reward for trial in world.play(contexts, actions, rng)] for world in worlds], axis=0)
    for reward, action in zip(earned, actions, strict=True):
        commanded = np.broadcast_to(action, (len(truths), 1, len(action)))
        expected = simulators().solver.expected_rewards(truths, context, commanded, rng)
        assert reward == pytest.approx(expected.mean(), abs=0.05)


def test_discrepancies_are_drawn_with_the_world_and_make_worlds_differ() -> None:
    first, second = (_world(simulators(), 0, number) for number in (0, 1))
    again = _world(simulators(), 0, 0)
    assert np.array_equal(first.parameters, again.parameters)
    assert np.array_equal(first.factors, again.factors)
    assert first.seed == again.seed != second.seed


def test_a_world_answers_the_same_action_alike_and_near_actions_alike() -> None:
    world = ImaginedWorld(simulators(), simulators().truths[3], 5, np.ones(1 + len(simulators().end_unit)))
    contexts = np.tile(TOY.context.middle, (200, 1))
    actions = np.tile(TOY.action.middle, (200, 1))
    chances = [
        np.mean([t.reward > 0.01 for t in world.play(contexts, actions, np.random.default_rng(s))]) for s in (1, 2)
    ]
    assert chances[0] == pytest.approx(chances[1], abs=0.15)


@pytest.mark.parametrize(
    ("counts", "half", "most"),
    [
        ([1, 1, 1, 2, None], SessionShare(most=1, share=0.6), SessionShare(most=2, share=0.8)),
        ([1, None, None, None], SessionShare(share=0.25), SessionShare(share=0.25)),
        ([4] * 10, SessionShare(most=4, share=1.0), SessionShare(most=4, share=1.0)),
    ],
)
def test_a_share_is_that_of_the_sessions_that_need_no_more(
    counts: list[int | None], half: SessionShare, most: SessionShare
) -> None:
    assert (needed(counts).half, needed(counts).four_of_five) == (half, most)


def test_larger_gains_are_shown_after_fewer_pairs() -> None:
    rng = np.random.default_rng(0)
    sessions = [rng.normal(gain, 0.3, 20) for gain in np.linspace(-0.1, 0.8, 40)]
    shown = [pairs_until_shown(sessions, gain) for gain in DIFFERENCES]
    assert {len(counts) for counts in shown} == {len(shown[0])}
    by_30 = [np.mean([count is not None and count <= 30 for count in counts]) for counts in shown]
    assert by_30[0] < by_30[1] < by_30[2]
    assert by_30[2] > 0.5


@pytest.mark.long
def test_a_forecast_is_kept_beside_its_checkpoint_and_no_other(tmp_path: Path) -> None:
    folder = save_checkpoint(TOY, tmp_path / "mine", trained()[0], {}, {"seed": 7}, reward_table())
    checkpoint = load_checkpoint(TOY, str(folder))
    made = forecast(checkpoint, sessions=6)
    assert made == forecast(checkpoint, sessions=6), "the same seed gives the same forecast"
    assert made.trials == 5 * 2 * TOY.adaptation.trials_per_iteration
    assert [one.difference for one in made.shown] == list(DIFFERENCES)
    save(made, folder)
    assert load(folder, checkpoint.sha256) == made
    assert load(folder, "another") is None
    (folder / FILE).write_text("sessions = 'many'\n")
    assert load(folder, checkpoint.sha256) is None
    assert load_checkpoint(TOY, str(folder)).sha256 == checkpoint.sha256


@pytest.mark.long
def test_a_first_success_is_a_trial_and_the_stop_comes_after_two_iterations() -> None:
    pendulum = load_checkpoint(get_task("pendulum"), "default")
    heard: list[int] = []
    played = imagine(pendulum, 2, sessions=3, progress=lambda done, total: heard.append(done))
    assert heard == [1, 2, 3]
    for one in played:
        assert len(one.differences) == 2
        assert one.first_success in (None, 2, 4)
        refuted = is_refuted(one.history[-1][0])
        assert one.kinds[-1].stops or refuted, "two iterations are enough unless the last one refutes its policy"


@pytest.mark.parametrize("task", TASKS)
def test_shipped_checkpoints_have_theirs(task: str) -> None:
    checkpoint = load_checkpoint(get_task(task), "default")
    kept = load(checkpoint.path, checkpoint.sha256)
    assert kept is not None, f"adaptsim checkpoints trials --task {task}"
    assert kept.sessions >= 64
    assert kept.seed == 0


@pytest.mark.slow
def test_the_shipped_forecast_of_the_pendulum_comes_out_again() -> None:
    checkpoint = load_checkpoint(get_task("pendulum"), "default")
    assert load(checkpoint.path, checkpoint.sha256) == forecast(checkpoint)
