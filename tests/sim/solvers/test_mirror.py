"""Learning from mirrored rollouts, on the toy task: the sign of its nuisance is the side."""

import dataclasses

import numpy as np
import pytest
from toy_learning import SETTINGS, dataset
from toy_task import TOY

from sim.rollouts import Dataset
from sim.solvers.emulator.training import train_emulator, with_mirror_images
from sim.tasks import get_task
from sim.tasks.own_object import OwnObject, with_ranges
from sim.tasks.task import Mirror

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


@pytest.mark.parametrize("signs", [(1.0, 1.0), (-1.0, -1.0)])
def test_the_mirror_image_of_a_mirror_image_is_the_rollout(signs):
    mirror = dataclasses.replace(MIRROR, observed=np.array(signs))
    task, given, n = dataclasses.replace(TOY, mirror=mirror), dataset(), len(dataset())
    once = with_mirror_images(task, given)
    again = with_mirror_images(task, Dataset(once.requests[n:], once.rollouts[n:], n))
    assert np.allclose(again.rollouts.observation[n:], given.rollouts.observation)
    assert np.allclose(again.requests.nuisance[n:], given.requests.nuisance)


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
        said = emulator.predict(asked.parameters[right], asked.action[right], asked.nuisance[right]).observation
        return np.abs(said - done.observation[right]).mean()

    assert error(task) < 0.4 * error(dataclasses.replace(task, mirror=None))


def test_an_own_object_keeps_the_symmetry_only_if_its_ranges_do():
    pushing = get_task("pushing")
    centred, aside = ({"y_p": (-0.05, 0.05)}, {"y_p": (0.02, 0.06)})
    assert with_ranges(pushing, OwnObject("pushing", "jar", centred)).mirror is pushing.mirror
    assert with_ranges(pushing, OwnObject("pushing", "jar", {"mu": (0.1, 0.2)})).mirror is pushing.mirror
    assert with_ranges(pushing, OwnObject("pushing", "jar", aside)).mirror is None
