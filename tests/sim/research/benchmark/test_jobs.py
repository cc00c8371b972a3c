"""Sessions of a benchmark on the pendulum, whose rollouts are exact and cheap."""

from concurrent.futures import Executor, Future
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from sim.adaptation.checkpoint import load_checkpoint
from sim.adaptation.methods import make_method
from sim.errors import DatasetError, OutOfRange
from sim.lab.world import load_world
from sim.research.benchmark import run
from sim.research.benchmark.jobs import Job, run_job
from sim.research.benchmark.run import Results, run_jobs
from sim.research.benchmark.sessions import Conditions, choose_oracle, estimated_reward, run_session
from sim.research.benchmark.tables import WorldTable
from sim.research.benchmark.trial_sources import SimulatedTrials, TableTrials
from sim.rollouts.dataset import draw_requests
from sim.rollouts.executors import serial_executor
from sim.rollouts.run import Rollouts
from sim.tasks import get_task

PENDULUM = get_task("pendulum")
CONDITIONS = Conditions(budget=5, candidates=16)


def job(method, seed=0, world="wd", conditions=CONDITIONS):
    found = load_world(world, PENDULUM)
    return Job("pendulum", "default", "named", world, "0" * 16, method, seed, conditions, found)


class Recorded:
    """A place that writes down which contexts and streams it was asked for."""

    executable = None

    def __init__(self):
        self.inner = SimulatedTrials(load_checkpoint(PENDULUM).solver, load_world("wd", PENDULUM))
        self.draws = []

    def take(self, action):
        self.inner.take(action)

    def play(self, contexts, actions, rng):
        self.draws.append(rng.bit_generator.state["state"]["state"])
        return self.inner.play(contexts, actions, rng)


def test_a_session_uses_whole_iterations_of_its_budget_and_its_curve_ends_where_it_ends():
    row = run_job(job("adaptsim"))
    assert row.real_trials == 4
    assert [n for n, _ in row.curve] == [2, 4]
    assert row.curve[-1][1] == row.reward
    assert 0.8 < row.reward <= 1.0
    assert row.ci95 == (row.reward, row.reward)
    with pytest.raises(OutOfRange, match="a budget of 1 trials is less than one iteration of pendulum"):
        Conditions(budget=1).iterations(PENDULUM)


def test_every_method_meets_the_same_chance():
    checkpoint, seen = load_checkpoint(PENDULUM), []
    for name in ("random", "adaptsim-belief", "learn-in-target"):
        place = Recorded()
        run_session(checkpoint.solver, make_method(name, PENDULUM, checkpoint), place, CONDITIONS, seed=3)  # type: ignore[arg-type]
        seen.append(place.draws)
    assert seen[0] == seen[1] == seen[2]
    assert len(set(seen[0])) == 4


def test_the_limits_bound_what_methods_earn():
    best, oracle, udr = (run_job(job(name)) for name in ("best-action", "oracle", "udr"))
    assert best.reward == pytest.approx(1.0)
    assert udr.reward < oracle.reward <= best.reward
    assert (udr.real_trials, oracle.real_trials, best.real_trials) == (0, 0, 0)
    assert udr.shown == pytest.approx(udr.reward)
    checkpoint = load_checkpoint(PENDULUM)
    place = SimulatedTrials(checkpoint.solver, load_world("ood-2", PENDULUM))
    chosen, _ = choose_oracle(checkpoint.solver, place, CONDITIONS, 0)
    earned = estimated_reward(PENDULUM, chosen.actions, place, CONDITIONS, 0).mean
    middle = checkpoint.solver.policies(
        PENDULUM.parameters.denormalise(np.full((1, 1, 4), 0.5)), np.random.default_rng(0)
    )
    assert earned > estimated_reward(PENDULUM, middle[0].actions, place, CONDITIONS, 0).mean


@pytest.mark.long
def test_final_policies_may_be_scored_by_true_rollouts_of_their_own_number():
    few = replace(CONDITIONS, fresh=8)
    plain, fresh = run_job(job("adaptsim")), run_job(job("adaptsim", conditions=few))
    assert fresh.curve == plain.curve
    context = replace(CONDITIONS, judged=8)
    checkpoint = load_checkpoint(PENDULUM)
    place = SimulatedTrials(checkpoint.solver, load_world("wd", PENDULUM))
    method = make_method("adaptsim", PENDULUM, checkpoint)
    last = run_session(checkpoint.solver, method, place, few, 0)[-1]
    assert fresh.reward == estimated_reward(PENDULUM, last.actions, place, context, 0).mean


def test_with_fresh_rollouts_no_trial_is_looked_up(monkeypatch):
    task = get_task("pushing")
    nothing = Rollouts(np.zeros((8, task.observation.size)), np.zeros((8, 2)), np.zeros(8, bool), np.zeros(8, np.int8))
    table = WorldTable("wd", draw_requests(task, 8, np.random.default_rng(0)), nothing, "0" * 16)
    looked_up: list[int] = []
    monkeypatch.setattr(TableTrials, "play", lambda self, contexts, *rest: looked_up.append(len(contexts)))
    contact = Job(
        task="pushing",
        checkpoint="default",
        set="named",
        target="wd",
        answers="0" * 16,
        world=load_world("wd", task),
        table=table,
        method="random",
        seed=0,
        conditions=Conditions(budget=2, particles=1, judged=2, fresh=2),
    )
    row = run_job(contact)
    assert not looked_up
    assert row.curve == ((2, 0.0),)  # of the table, where everything fails


def test_rows_say_what_simulations_they_rest_on():
    assert run_job(job("learn-in-target")).simulations == 0
    assert run_job(job("random")).simulations == 0  # the pendulum's policies are exact
    assert run_job(job("adaptsim-iteration")).simulations == load_checkpoint(PENDULUM).card.simulations


def test_the_same_job_earns_the_same_and_another_seed_something_else():
    one, again, other = (run_job(job("random", seed)) for seed in (0, 0, 1))
    assert replace(one, wall_s=0.0) == replace(again, wall_s=0.0)
    assert one.reward != other.reward


def test_a_killed_benchmark_goes_on_and_keeps_what_is_finished(tmp_path):
    jobs = [job(name, seed) for name in ("udr", "oracle", "random") for seed in range(2)]
    results, told = Results(tmp_path), []
    with serial_executor() as executor:
        first = run_jobs(jobs[:3], results, executor, lambda done, total: None, run_job)
        damaged = results._path(jobs[1])
        damaged.write_text(damaged.read_text()[:20])
        rows = run_jobs(jobs, results, executor, lambda done, total: told.append((done, total)), run_job)
    assert told[0] == (2, 6)
    assert told[-1] == (6, 6)
    assert [(r.method, r.seed) for r in rows] == [(j.method, j.seed) for j in jobs]
    assert rows[0] == first[0]
    assert rows[0].wall_s == first[0].wall_s  # read, not run again


def test_other_conditions_need_another_folder(tmp_path):
    Results(tmp_path).agree({"format": 1, "task": "pendulum"})
    Results(tmp_path).agree({"format": 1, "task": "pendulum"})
    with pytest.raises(DatasetError, match="holds results with a different task: give another --out"):
        Results(tmp_path).agree({"format": 1, "task": "pushing"})


def test_what_a_job_raises_ends_the_benchmark_and_keeps_the_rest(tmp_path, monkeypatch):
    jobs = [job("udr"), job("random")]

    class Failing(Executor):
        def submit(self, call, asked):  # type: ignore[override]
            future: Future[Any] = Future()
            if asked.method == "udr":
                future.set_result(call(asked))
            else:
                future.set_exception(DatasetError("gone"))
            return future

    with pytest.raises(DatasetError, match="gone"):
        run_jobs(jobs, Results(tmp_path), Failing(), lambda done, total: None, run_job)
    assert run.Results(tmp_path).row(jobs[0]).method == "udr"
