import dataclasses

import numpy as np
import pytest
import torch
from threadpoolctl import threadpool_info, threadpool_limits
from toy_learning import SETTINGS, dataset, trained
from toy_task import TOY

from sim.adaptation.checkpoint import load_checkpoint
from sim.errors import CheckpointError, DatasetError
from sim.rollouts.dataset import Dataset
from sim.solvers.emulator.network import Emulator, encode, rescaled_to
from sim.solvers.emulator.training import _temperature, forward, train_emulator, with_mirror_images
from sim.solvers.threads import one_blas_thread
from sim.tasks import get_task
from sim.tasks.own_object import OwnObject, with_ranges
from sim.tasks.task import Mirror
from sim.types import Dimension, Space


def draws(n, seed=0):
    rng = np.random.default_rng(seed)
    parameters, action, nuisance = TOY.margin.sample(rng, n), TOY.action.sample(rng, n), TOY.nuisance.sample(rng, n)
    return parameters, np.tile(TOY.reference_context, (n, 1)), action, nuisance


def test_it_learns_the_toy_and_says_how_well():
    _, report = trained()
    assert report.accuracy > 0.9 > max(report.base_rate, 1.0 - report.base_rate)
    assert report.brier < 0.08
    assert report.calibration_error < 0.12
    assert report.position_error_median < 0.01
    assert report.end_state_error_median < 0.005


def test_few_held_out_rollouts_do_not_make_it_certain():
    """All of them may happen to be predicted well: the likelihood alone then asks for the sharpest temperature."""
    emulator, _ = trained()
    asked = dataset().requests
    said = emulator.predict(asked.parameters, asked.context, asked.action, asked.nuisance).success
    well = np.flatnonzero(np.abs(said - dataset().rollouts.succeeded) < 0.2)[:150]
    assert 0.3 < _temperature(emulator, dataset(), well) < 1.0


def test_disagreement_grows_outside_of_the_data():
    emulator, _ = trained()
    parameters, context, action, nuisance = draws(300)
    far = parameters.copy()
    far[:, [0, 3]] += 1.5 * (TOY.margin.high - TOY.margin.low)[[0, 3]]
    inside, outside = (
        emulator.outcomes(p, action, nuisance, context).end_state.std(0).mean() for p in (parameters, far)
    )
    assert outside > 3.0 * inside


def test_outcomes_broadcast_and_agree_with_predict():
    emulator, _ = trained()
    parameters, context, action, nuisance = draws(6)
    predicted = emulator.outcomes(parameters, action[:3, None, :], nuisance, context)
    success, end_state = predicted.success, predicted.end_state
    assert success.shape == (5, 3, 6)
    assert end_state.shape == (5, 3, 6, 1)
    assert predicted.failure_reward is None
    single = emulator.predict(parameters[4:5], context[4:5], action[2:3], nuisance[4:5])
    assert success[:, 2, 4].mean() == pytest.approx(single.success[0], abs=1e-5)
    assert end_state[:, 2, 4].mean() == pytest.approx(single.end_state[0, 0], abs=1e-5)


def test_the_same_seed_gives_the_same_weights_whatever_the_threads():
    quick = dataclasses.replace(SETTINGS, least_steps=40, most_steps=40)
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    one, _ = train_emulator(TOY, dataset(), 3, quick)
    torch.set_num_threads(1)
    two, _ = train_emulator(TOY, dataset(), 3, quick)
    torch.set_num_threads(before)
    assert all(np.array_equal(one.tensors[name], two.tensors[name]) for name in one.tensors)
    three, _ = train_emulator(TOY, dataset(), 4, quick)
    assert not np.array_equal(one.tensors["w0"], three.tensors["w0"])


def test_predictions_are_those_of_the_network_that_was_trained():
    emulator, _ = trained()
    parameters, context, action, nuisance = draws(700)  # more than are evaluated at once
    tensors = {name: torch.from_numpy(t) for name, t in emulator.tensors.items()}
    x = torch.from_numpy(encode(TOY, parameters, context, action, nuisance)).expand(emulator.members, -1, -1)
    raw = forward(tensors, int(tensors["depth"]), x) * tensors["y_std"] + tensors["y_mean"]
    end_state = emulator.outcomes(parameters, action, nuisance, context).end_state
    assert end_state == pytest.approx(raw[..., TOY.observation.size : -1].numpy(), abs=1e-5)


def test_stored_tensors_restore_it_exactly_and_foreign_ones_are_refused():
    emulator, _ = trained()
    again = Emulator(TOY, emulator.tensors)
    assert np.array_equal(again.predict(*draws(5)).observation, emulator.predict(*draws(5)).observation)
    with pytest.raises(CheckpointError, match="the emulator has no"):
        Emulator(TOY, {"w0": np.zeros(1)})
    more = Space((*TOY.nuisance.dimensions, Dimension("x", "", 0.0, 1.0)))
    with pytest.raises(CheckpointError, match="does not fit toy"):
        Emulator(dataclasses.replace(TOY, nuisance=more), emulator.tensors)


def test_whole_parameters_are_one_hot_and_blend_in_between():
    parameters = np.array([[0.3, 1e5, 1.0, 2.0], [0.3, 1e5, 0.5, 2.0]])
    features = encode(TOY, parameters, TOY.reference_context, TOY.action.low, TOY.nuisance.low)
    assert features.shape == (2, 3 + 3 + 2 + 1)
    assert features[0, 2:5].tolist() == [0.0, 1.0, 0.0]
    assert features[1, 2:5].tolist() == [0.5, 0.5, 0.0]
    assert np.abs(np.delete(features, [2, 3, 4], axis=1)).max() <= 1.0


def test_too_little_data_is_refused():
    few = dataclasses.replace(dataset(), rollouts=dataset().rollouts[:10])
    with pytest.raises(DatasetError, match="10 rollouts are too few"):
        train_emulator(TOY, few, 0)


OBJECTS = {
    "pushing": OwnObject("pushing", "milk", {"mu": (0.08, 0.16), "e": (1e5, 1e6)}),
    "scooping": OwnObject("scooping", "tofu", {"h": (2.0, 2.6), "g": (1, 2)}, {"radius": (0.012, 0.02)}),
}


def emulator_of(name: str) -> Emulator:
    found = load_checkpoint(get_task(name)).emulator
    assert found is not None
    return found


@pytest.mark.parametrize("name", OBJECTS)
def test_the_networks_of_an_object_predict_what_they_predicted_for_the_task(name: str) -> None:
    shipped, task = emulator_of(name), with_ranges(get_task(name), OBJECTS[name])
    own, rng = rescaled_to(shipped, task), np.random.default_rng(0)
    given = [space.sample(rng, 200) for space in (task.margin, task.context, task.action, task.nuisance)]
    before, after = shipped.predict(*given), own.predict(*given)
    assert own.task is task
    assert np.allclose(after.observation, before.observation, atol=2e-5)
    assert np.allclose(after.success, before.success, atol=2e-4)
    assert not np.array_equal(own.tensors["w0"], shipped.tensors["w0"])


def test_other_whole_numbers_are_refused() -> None:
    task = get_task("scooping")
    g = task.margin.names.index("g")
    fewer = [dataclasses.replace(d, high=1) if i == g else d for i, d in enumerate(task.margin.dimensions)]
    with pytest.raises(CheckpointError, match="other integer values"):
        rescaled_to(emulator_of("scooping"), dataclasses.replace(task, margin=Space(tuple(fewer))))


def threads() -> set[int]:
    assert np.eye(3) @ np.eye(3) is not None  # its library is loaded
    return {library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"}


def test_small_matrices_are_multiplied_on_one_thread_inside_and_as_many_as_before_outside() -> None:
    with threadpool_limits(2, user_api="blas"):
        before = threads()
        with one_blas_thread():
            assert threads() == {1}
        assert threads() == before


MIRROR = Mirror(
    parameters=np.ones(4),
    action=np.ones(2),
    nuisance=np.array([-1.0]),
    observed=np.array([1.0, -1.0]),
    end_state=np.array([-1.0]),
)
MIRRORED = dataclasses.replace(TOY, mirror=MIRROR)


def test_a_task_without_symmetry_learns_from_its_rollouts_alone():
    assert with_mirror_images(TOY, dataset()) is dataset()


def test_mirror_images_follow_in_the_same_order():
    given = dataset()
    both, n = with_mirror_images(MIRRORED, given), len(given)
    assert len(both) == 2 * n
    assert np.array_equal(both.requests.nuisance, np.concatenate([given.requests.nuisance, -given.requests.nuisance]))
    for name in ("parameters", "action"):
        assert np.array_equal(getattr(both.requests, name), np.tile(getattr(given.requests, name), (2, 1)))
    for name in ("succeeded", "outcome"):
        assert np.array_equal(getattr(both.rollouts, name), np.tile(getattr(given.rollouts, name), 2))
    ends = given.rollouts.end_state
    assert np.array_equal(both.rollouts.end_state, np.concatenate([ends, -ends]), equal_nan=True)
    seen, mirrored = (TOY.observation.denormalise(half) for half in np.split(both.rollouts.observation, 2))
    assert np.allclose(mirrored, seen * [1.0, -1.0])


def test_an_emulator_knows_the_other_side_from_one_side_alone():
    """It learns from rollouts of one side, and is judged on the other."""
    task = dataclasses.replace(TOY, mirror=dataclasses.replace(MIRROR, end_state=np.array([1.0])))
    asked, done = dataset().requests, dataset().rollouts
    observation = TOY.observation.denormalise(done.observation)
    observation[..., 1] = 0.08 * asked.nuisance  # (N, M): it moves towards the side
    done = dataclasses.replace(done, observation=TOY.observation.normalise(observation))
    left = asked.nuisance[:, 0] > 0.0
    rows = np.flatnonzero(left)
    half = Dataset(asked[rows], done[rows], len(rows))
    quick = dataclasses.replace(SETTINGS, least_steps=200, most_steps=200)

    def error(task):
        emulator, report = train_emulator(task, half, 0, quick)
        assert report.rollouts < len(half)  # mirror images are not counted
        right = ~left
        of_right = asked[np.flatnonzero(right)]
        said = emulator.predict(of_right.parameters, of_right.context, of_right.action, of_right.nuisance).observation
        return np.abs(said - done.observation[right]).mean()

    assert error(task) < 0.4 * error(dataclasses.replace(task, mirror=None))


def test_an_own_object_keeps_the_symmetry_only_if_its_ranges_do():
    pushing = get_task("pushing")
    centred, aside = ({"y_p": (-0.05, 0.05)}, {"y_p": (0.02, 0.06)})
    assert with_ranges(pushing, OwnObject("pushing", "jar", centred)).mirror is pushing.mirror
    assert with_ranges(pushing, OwnObject("pushing", "jar", {"mu": (0.1, 0.2)})).mirror is pushing.mirror
    assert with_ranges(pushing, OwnObject("pushing", "jar", aside)).mirror is None


@pytest.mark.parametrize("signs", [(1.0, 1.0), (-1.0, -1.0)])
def test_the_mirror_image_of_a_mirror_image_is_the_rollout(signs):
    mirror = dataclasses.replace(MIRROR, observed=np.array(signs))
    task, given, n = dataclasses.replace(TOY, mirror=mirror), dataset(), len(dataset())
    once = with_mirror_images(task, given)
    again = with_mirror_images(task, Dataset(once.requests[n:], once.rollouts[n:], n))
    assert np.allclose(again.rollouts.observation[n:], given.rollouts.observation)
    assert np.allclose(again.requests.nuisance[n:], given.requests.nuisance)
