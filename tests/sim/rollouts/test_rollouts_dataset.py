import dataclasses
from functools import partial

import numpy as np
import pytest
from toy_task import ACTION, TOY, Counted, best_action, simulate

from sim.errors import DatasetError, RolloutError
from sim.rollouts.dataset import AdaptiveSampling, build_dataset, build_share, dataset_requests, load_dataset
from sim.rollouts.draws import cover, sobol
from sim.rollouts.executors import serial_executor
from sim.rollouts.run import run_many
from sim.rollouts.shards import CachedRollouts
from sim.rollouts.shares import Share
from sim.solvers.emulator.training import outcome_variance
from sim.types import Dimension, Space


def other_scene(parameters, context, action, nuisance, unmodelled=None):
    return simulate(parameters, context, action * 1.2, nuisance, unmodelled)


def build(folder, size=600, seed=0, task=TOY, denser=0):
    with serial_executor() as executor:
        more = AdaptiveSampling(denser, partial(outcome_variance, task, 0)) if denser else None
        return build_dataset(task, folder, size, seed, executor, denser=more)


def test_the_draws_fill_margin_action_and_nuisance_evenly():
    requests = dataset_requests(TOY, 0, 512)
    assert all(TOY.margin.contains(p) for p in requests.parameters)
    assert np.bincount(requests.parameters[:, 2].astype(int)).tolist() == pytest.approx([171, 171, 170], abs=2)
    assert np.isclose(requests.action.min(axis=0), TOY.action.low - TOY.action_noise, atol=0.01).all()
    assert np.isclose(TOY.margin.normalise(requests.parameters).mean(axis=0), 0.5, atol=0.01).all()


def test_a_larger_dataset_extends_a_smaller_one(tmp_path):
    small = build(tmp_path, 300)
    large = build(tmp_path, 700)
    assert np.array_equal(large.rollouts.observation[:300], small.rollouts.observation)
    assert len(large) == 700


def test_the_same_seed_gives_the_same_dataset_and_another_does_not(tmp_path):
    one, two, three = build(tmp_path / "a"), build(tmp_path / "b"), build(tmp_path / "c", seed=1)
    assert one.identity == two.identity != three.identity
    assert not one.rollouts.observation.flags.writeable


def test_a_killed_build_goes_on_where_it_was(tmp_path):
    counted = Counted()
    with pytest.raises(RolloutError, match="power cut"):
        build(tmp_path, task=Counted(most=300).task)
    resumed = build(tmp_path, task=counted.task)
    assert counted.count == 600 - 256 + 2  # the first shard stands; two probes
    assert resumed.identity == build(tmp_path / "fresh").identity


@pytest.mark.long
def test_the_second_part_is_denser_where_the_outcome_changes(tmp_path):
    dataset = build(tmp_path, 1024, denser=512)
    assert (len(dataset), dataset.uniform) == (1536, 1024)
    pairs = zip(dataset.requests.action, dataset.requests.parameters, strict=True)
    miss = np.array([ACTION.normalise(a) - best_action(p) for a, p in pairs])
    rim = np.abs(np.linalg.norm(miss, axis=1) - 0.45) < 0.1  # the toy's scoop works up to a miss of 0.42 to 0.48
    assert rim[1024:].mean() > 1.5 * rim[:1024].mean()
    assert build(tmp_path, 1024, denser=512).identity == dataset.identity == load_dataset(tmp_path, TOY).identity


@pytest.mark.long
def test_a_killed_denser_part_goes_on_with_the_rollouts_that_were_chosen(tmp_path):
    with pytest.raises(RolloutError, match="power cut"):
        build(tmp_path, 256, task=Counted(most=300).task, denser=300)
    chosen = (tmp_path / "denser.npz").read_bytes()
    resumed = build(tmp_path, 256, denser=300)
    assert (tmp_path / "denser.npz").read_bytes() == chosen
    assert resumed.identity == build(tmp_path / "fresh", 256, denser=300).identity


@pytest.mark.long
def test_what_was_chosen_by_a_first_part_is_not_mixed_with_another(tmp_path):
    build(tmp_path, 256, denser=128)
    with pytest.raises(DatasetError, match="chosen by those"):
        build(tmp_path, 512, denser=128)
    (tmp_path / "denser.npz").write_bytes(b"nothing")
    with pytest.raises(DatasetError, match="cannot be read"):
        load_dataset(tmp_path, TOY)


@pytest.mark.parametrize("damage", [lambda b: b[: len(b) // 2], lambda b: b"", lambda b: b[:900] + b"x" * 50 + b[950:]])
def test_a_damaged_shard_is_found_and_redone_alone(tmp_path, damage):
    whole = build(tmp_path)
    shard = tmp_path / "shard-00001.npz"
    shard.write_bytes(damage(shard.read_bytes()))
    with pytest.raises(DatasetError, match="shard-00001"):
        load_dataset(tmp_path, TOY)
    counted = Counted()
    assert build(tmp_path, task=counted.task).identity == whole.identity
    assert counted.count == 256 + 2


def test_another_seed_scene_or_range_is_refused(tmp_path):
    build(tmp_path)
    with pytest.raises(DatasetError, match="seed = 0, wanted 1"):
        build(tmp_path, seed=1)
    with pytest.raises(DatasetError, match="scene of toy has changed"):
        build(tmp_path, task=dataclasses.replace(TOY, simulate=other_scene))
    wider = Space((*TOY.margin.dimensions[:3], Dimension("h", "cm", 1.0, 3.0)))
    with pytest.raises(DatasetError, match="other ranges"):
        load_dataset(tmp_path, dataclasses.replace(TOY, margin=wider))


def test_a_missing_or_malformed_manifest_says_what_to_do(tmp_path):
    with pytest.raises(DatasetError, match="build one with"):
        load_dataset(tmp_path, TOY)
    (tmp_path / "dataset.toml").write_text("task = ")
    with pytest.raises(DatasetError, match="not valid TOML"):
        load_dataset(tmp_path, TOY)
    (tmp_path / "dataset.toml").write_text('task = "toy"')
    with pytest.raises(DatasetError, match="has no denser, interface"):
        build(tmp_path)


def test_cached_rollouts_are_simulated_once(tmp_path):
    requests = dataset_requests(TOY, 3, 10)
    counted = Counted()
    with serial_executor() as executor:
        roll = CachedRollouts(counted.task, tmp_path, executor)
        counted.count = 0
        first, second = roll(requests), roll(requests)
        assert np.array_equal(first.observation, second.observation)
        probes = 8  # whether the scene is the same
        assert (counted.count - probes, roll.count()) == (10, 10)
        roll(dataset_requests(TOY, 4, 10))
        assert (counted.count - probes, roll.count()) == (20, 20)


def test_cached_rollouts_of_another_scene_are_not_used(tmp_path):
    requests = dataset_requests(TOY, 3, 10)
    other = dataclasses.replace(TOY, simulate=other_scene)
    with serial_executor() as executor:
        CachedRollouts(TOY, tmp_path, executor)(requests)
        there = CachedRollouts(other, tmp_path, executor)
        assert there.count() == 0
        assert np.array_equal(there(requests).observation, run_many(other, requests, executor).observation)
        assert there.count() == 10


def test_whole_numbers_get_equal_shares_of_the_draws():
    space = Space((Dimension("g", "", 0, 3, "integer"), Dimension("e", "", 1.0, 100.0, "log")))
    draws = cover(space, 64, np.random.default_rng(0))
    assert np.bincount(draws[:, 0].astype(int)).tolist() == [16, 16, 16, 16]
    assert np.median(draws[:, 1]) == pytest.approx(10.0, rel=0.1)
    assert sobol(5, 0, np.random.default_rng(0)).shape == (5, 0)


def build_a_share(folder, number, count, size=600, denser=0):
    counted = Counted()
    with serial_executor() as executor:
        more = AdaptiveSampling(denser, partial(outcome_variance, TOY, 0)) if denser else None
        complete = build_share(counted.task, folder, size, 0, Share(number, count), executor, denser=more)
    return complete, counted.count - 2  # two probes


def test_shares_are_joined_to_the_dataset_of_one_process(tmp_path):
    assert [build_a_share(tmp_path, k, 2) for k in (2, 1)] == [(True, 256), (True, 344)]
    assert build_a_share(tmp_path, 1, 2) == (True, 0)
    counted = Counted()
    assert build(tmp_path, task=counted.task).identity == build(tmp_path / "fresh").identity
    assert counted.count == 2


def test_more_shares_than_files_leave_some_without_work(tmp_path):
    assert [build_a_share(tmp_path, k, 5)[1] for k in range(1, 6)] == [256, 256, 88, 0, 0]


@pytest.mark.long
def test_the_denser_part_is_shared_once_the_first_part_is_whole(tmp_path):
    assert build_a_share(tmp_path, 1, 2, 512, 300) == (False, 256)
    assert build_a_share(tmp_path, 2, 2, 512, 300) == (True, 256 + 44)
    assert build_a_share(tmp_path, 1, 2, 512, 300) == (True, 256)
    assert build(tmp_path, 512, denser=300).identity == build(tmp_path / "fresh", 512, denser=300).identity


@pytest.mark.parametrize(("number", "count"), [(0, 2), (3, 2), (1, 0)])
def test_a_share_is_one_of_its_number(number, count):
    with pytest.raises(ValueError, match="is not a share"):
        Share(number, count)


def test_shares_divide_work_that_comes_in_parts_without_gap_or_overlap():
    parts = [list(range(start, start + 5)) for start in range(0, 35, 5)]
    shares = [[item for part in parts for item in Share(k, 3).of(part, part[0])] for k in (1, 2, 3)]
    assert shares == [list(range(k, 35, 3)) for k in range(3)]
