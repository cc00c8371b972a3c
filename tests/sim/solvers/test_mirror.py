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
ROWS = [field.name for field in dataclasses.fields(Dataset) if field.name not in ("uniform", "identity")]


def test_a_task_without_symmetry_learns_from_its_rollouts_alone():
    assert with_mirror_images(TOY, dataset()) is dataset()


def test_mirror_images_follow_in_the_same_order():
    given = dataset()
    both, n = with_mirror_images(MIRRORED, given), len(given)
    assert len(both) == 2 * n
    for name in ROWS:
        assert np.array_equal(getattr(both, name)[:n], getattr(given, name), equal_nan=True)
    for name in ("parameters", "action", "succeeded", "outcome"):
        assert np.array_equal(getattr(both, name)[n:], getattr(given, name))
    assert np.array_equal(both.nuisance[n:], -given.nuisance)
    assert np.array_equal(both.end_state[n:], -given.end_state, equal_nan=True)
    seen, mirrored = (TOY.observation.denormalise(both.observation[rows]) for rows in (slice(n), slice(n, None)))
    assert np.allclose(mirrored, seen * [1.0, -1.0])


@pytest.mark.parametrize("signs", [(1.0, 1.0), (-1.0, -1.0)])
def test_the_mirror_image_of_a_mirror_image_is_the_rollout(signs):
    mirror = dataclasses.replace(MIRROR, observed=np.array(signs))
    task, given, n = dataclasses.replace(TOY, mirror=mirror), dataset(), len(dataset())
    once = with_mirror_images(task, given)
    images = dataclasses.replace(given, **{name: getattr(once, name)[n:] for name in ROWS})
    again = with_mirror_images(task, images)
    assert np.allclose(again.observation[n:], given.observation)
    assert np.allclose(again.nuisance[n:], given.nuisance)


def test_an_emulator_knows_the_other_side_from_one_side_alone():
    """It learns from rollouts of one side, and is judged on the other."""
    task = dataclasses.replace(TOY, mirror=dataclasses.replace(MIRROR, end_state=np.array([1.0])))
    data = dataset()
    observation = TOY.observation.denormalise(data.observation)
    observation[..., 1] = 0.08 * data.nuisance  # (N, M): it moves towards the side
    data = dataclasses.replace(data, observation=TOY.observation.normalise(observation))
    left = data.nuisance[:, 0] > 0.0
    half = dataclasses.replace(data, **{name: getattr(data, name)[left] for name in ROWS}, uniform=int(left.sum()))

    def error(task):
        emulator, report = train_emulator(task, half, 0, SETTINGS)
        assert report.rollouts < len(half)  # mirror images are not counted
        right = ~left
        said = emulator.predict(data.parameters[right], data.action[right], data.nuisance[right]).observation
        return np.abs(said - data.observation[right]).mean()

    assert error(task) < 0.4 * error(dataclasses.replace(task, mirror=None))


def test_an_own_object_keeps_the_symmetry_only_if_its_ranges_do():
    pushing = get_task("pushing")
    centred, aside = ({"y_p": (-0.05, 0.05)}, {"y_p": (0.02, 0.06)})
    assert with_ranges(pushing, OwnObject("pushing", "jar", centred)).mirror is pushing.mirror
    assert with_ranges(pushing, OwnObject("pushing", "jar", {"mu": (0.1, 0.2)})).mirror is pushing.mirror
    assert with_ranges(pushing, OwnObject("pushing", "jar", aside)).mirror is None
