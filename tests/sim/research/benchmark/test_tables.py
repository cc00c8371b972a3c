"""World tables, made of the toy task's rollouts in its own worlds."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from toy_learning import trained
from toy_task import ACTION, PARAMETERS, TOY, Unmodelled, simulate

from sim.errors import DatasetError
from sim.lab.world import Faults, Sensing, World
from sim.research.benchmark import tables
from sim.research.benchmark.tables import MANIFEST, PlannedTable, load_table, table_requests
from sim.research.benchmark.trial_sources import TableTrials
from sim.rollouts.executors import serial_executor
from sim.rollouts.shares import Share

TRUTH = PARAMETERS.denormalise(np.array([0.85, 0.5, 0.0, 0.15]))
WORLD = World("windy", "toy", "", TRUTH, np.zeros(1), Unmodelled(wind_m=0.01), Sensing(), Faults())
SIZE = 160


@pytest.fixture(autouse=True)
def _toy(monkeypatch):
    """The toy is no registered task, so its rollouts in a world are made here."""

    def task_in(world, task):
        def count(parameters, context, action, nuisance, unmodelled=None):
            counted.append(action)
            return simulate(world.parameters, context, action, world.nuisance, world.unmodelled)

        return replace(task, simulate=count, simulate_many=None)

    monkeypatch.setattr(tables, "task_in", task_in)


counted: list[Any] = []


def solver():
    return trained()[0]


def build(folder, world=WORLD, size=SIZE, policies="abc", scene="scene"):
    counted.clear()
    told = []
    with serial_executor() as executor:
        planned = PlannedTable(solver(), policies, scene, world, folder, size)
        table = planned.build(executor, lambda done, total: told.append((done, total)))
    return table, told


def test_a_table_holds_true_rollouts_of_policies_and_of_all_actions(tmp_path):
    table, told = build(tmp_path)
    assert told[-1] == (SIZE, SIZE)
    assert len(counted) == len(table.actions) == SIZE
    i = int(np.flatnonzero(table.rollouts.succeeded)[0])
    track = simulate(TRUTH, TOY.reference_context, table.actions[i], np.zeros(1), WORLD.unmodelled)
    assert np.allclose(table.rollouts.observation[i], TOY.observation(track))
    assert table.rollouts.end_state[i] == pytest.approx(TOY.end_state(track))
    unit = ACTION.normalise(table.actions)
    hit = np.histogram2d(unit[:, 0], unit[:, 1], bins=4, range=[[0, 1], [0, 1]])[0]
    assert (hit > 0).all()
    even, odd = table.half(odd=False), table.half(odd=True)
    assert len(even[0]) == len(odd[0]) == SIZE // 2
    assert not {a.tobytes() for a in even[0].action} & {a.tobytes() for a in odd[0].action}


def test_a_killed_run_goes_on_and_a_damaged_shard_alone_is_made_again(tmp_path):
    whole, _ = build(tmp_path)
    shards = sorted(tmp_path.glob("shard-*.npz"))
    assert len(shards) == 3
    shards[1].unlink()
    content = bytearray(shards[2].read_bytes())
    content[len(content) // 2] ^= 1
    shards[2].write_bytes(content)
    with pytest.raises(DatasetError, match=r"shard-0001\.npz is missing or damaged"):
        load_table(TOY, WORLD, "scene", tmp_path)
    again, _ = build(tmp_path)
    assert len(counted) == SIZE - tables.SHARD
    assert again.digest == whole.digest == load_table(TOY, WORLD, "scene", tmp_path).digest


def test_what_is_not_the_table_of_this_world_is_refused(tmp_path):
    with pytest.raises(DatasetError, match="adaptsim world-tables --task toy --targets windy"):
        load_table(TOY, WORLD, "scene", tmp_path)
    build(tmp_path)
    other = replace(WORLD, parameters=PARAMETERS.denormalise(np.zeros(4)))
    for world, scene in ((other, "scene"), (WORLD, "another")):
        with pytest.raises(DatasetError, match="another version of world windy, or of another scene"):
            load_table(TOY, world, scene, tmp_path)
    with pytest.raises(DatasetError, match="holds a table with a different size"):
        build(tmp_path, size=2 * SIZE)
    with pytest.raises(DatasetError, match="holds a table with a different world"):
        build(tmp_path, world=other)
    (tmp_path / MANIFEST).write_text("format = ")
    with pytest.raises(DatasetError, match="is not valid TOML"):
        load_table(TOY, WORLD, "scene", tmp_path)


def test_shards_that_were_exchanged_are_found(tmp_path):
    build(tmp_path / "a")
    build(tmp_path / "b", world=replace(WORLD, name="calm", unmodelled=Unmodelled()))
    (tmp_path / "a/shard-0001.npz").write_bytes((tmp_path / "b/shard-0001.npz").read_bytes())
    with pytest.raises(DatasetError, match=r"are not those of table\.toml"):
        load_table(TOY, WORLD, "scene", tmp_path / "a")


def test_requests_are_the_same_for_the_same_world_and_differ_between_worlds():
    one, same = (table_requests(solver(), WORLD, 64).action for _ in range(2))
    assert np.array_equal(one, same)
    assert not np.array_equal(one, table_requests(solver(), replace(WORLD, name="calm"), 64).action)


def test_a_looked_up_trial_is_the_true_one_nearby_and_scores_come_from_other_rollouts(tmp_path):
    table, _ = build(tmp_path, size=640)
    place, rng = TableTrials(TOY, table), np.random.default_rng(0)
    contexts, actions = TOY.context.sample(rng, 200), TOY.action.sample(rng, 200)
    played = place.play(contexts, actions, rng)
    observed, rewards = np.stack([t.observation for t in played]), np.array([t.reward for t in played])
    tracks = [simulate(TRUTH, c, a, np.zeros(1), WORLD.unmodelled) for c, a in zip(contexts, actions, strict=True)]
    true = np.array([TOY.score(t, c) for t, c in zip(tracks, contexts, strict=True)])
    seen = np.stack([TOY.observation(t) for t in tracks])
    assert np.median(np.abs(observed - seen)) < 0.03
    assert np.corrcoef(rewards, true)[0, 1] > 0.9
    judged = place.score(contexts, actions, rng)
    assert judged.mean() == pytest.approx(true.mean(), abs=0.05)
    assert not np.array_equal(judged, rewards)
    known = place.table.half(odd=False)[0].action
    exact = TableTrials(replace(TOY, action_noise=np.zeros(2)), table).play(contexts[:50], known[:50], rng)
    true = table.half(odd=False)[1].rewards(TOY, TOY.reference_context[None])[:50]
    assert np.array_equal([trial.reward for trial in exact], true)


def test_the_best_actions_of_a_table_earn_more_than_any_others(tmp_path):
    table, _ = build(tmp_path, size=640)
    place, rng = TableTrials(TOY, table), np.random.default_rng(1)
    contexts = TOY.context.sample(rng, 32)
    best = place.score(contexts, place.best_actions(contexts), rng).mean()
    others = [place.score(contexts, np.tile(a, (32, 1)), rng).mean() for a in TOY.action.sample(rng, 20)]
    assert best > max(others) - 0.02
    assert best > 0.85


def test_shares_are_joined_to_the_same_table(tmp_path):
    whole, _ = build(tmp_path / "whole")
    counted.clear()
    for number, rows in ((2, 64), (1, 96)):
        counted.clear()
        with serial_executor() as executor:
            planned = PlannedTable(solver(), "abc", "scene", WORLD, tmp_path / "shared", SIZE)
            files = planned.build_share(Share(number, 2), 0, executor, lambda *_: None)
        assert (files, len(counted)) == ((3 - number, 3), rows)
    with pytest.raises(DatasetError, match="there is no finished table"):
        load_table(TOY, WORLD, "scene", tmp_path / "shared")
    joined, _ = build(tmp_path / "shared")
    assert not counted
    assert joined.digest == whole.digest
