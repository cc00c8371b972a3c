"""What settings name: the posterior of another session to begin with, recorded trials, and the solver."""

from __future__ import annotations

from pathlib import Path

import pytest
from recordings import write_tables

from adaptsim_cli import api
from adaptsim_cli.commands import app
from adaptsim_cli.errors import UsageError
from adaptsim_cli.screen.outputs.sessions import ParameterBelief
from adaptsim_cli.session.checkpoint import solver_of
from adaptsim_cli.show.comparison import disagreements
from sim.adaptation.checkpoint import Checkpoint, load_checkpoint, save_checkpoint
from sim.errors import UnknownName
from sim.research.methods.q_policy import new_policy, tensors_of
from sim.research.naf.memory import NafMemory
from sim.research.naf.solver import NafSolver, naf_facts, rules_of
from sim.rollouts.run import Requests, Rollouts
from sim.tasks import get_task


def believed(session: str, low: float, high: float, parameter: str = "mu") -> ParameterBelief:
    return ParameterBelief(session=session, parameter=parameter, unit="", low=low, median=0.5 * (low + high), high=high)


def test_posteriors_disagree_where_their_intervals_have_nothing_in_common():
    apart = [believed("a", 0.1, 0.2), believed("b", 0.3, 0.4), believed("c", 0.15, 0.35)]
    assert disagreements(apart) == ("The posteriors disagree in mu: a has 0.1 to 0.2, b 0.3 to 0.4 (90 %).",)
    assert disagreements([believed("a", 0.1, 0.2), believed("b", 0.2, 0.3)]) == (
        "The posteriors disagree in no parameter: all 90 % intervals overlap.",
    )
    assert disagreements(apart[:1]) == ()


@pytest.mark.long
def test_a_session_begins_with_the_posterior_of_another_and_comparing_them_names_parameters(refused, printed):
    run = ["run-iteration", "--task", "pendulum", "--yes", "--world", "wd"]
    assert app.run([*run, "--session", "old"]) == 0
    old, new = api.open_session("old"), api.begin("pendulum", start_from="old", name="new")
    before, after = old.posterior(0).quantiles((0.05, 0.95)), new.posterior(0).quantiles((0.05, 0.95))
    assert (after[1] - after[0] <= before[1] - before[0] + 1e-9).all()
    assert (after[1] - after[0] < 0.7 * (before[1] - before[0])).any()
    new.run_iteration()
    assert new.facts.start_from == "old"
    assert "the posterior of session old" in (new.folder / "report.html").read_text()

    shown = printed("compare", "old", "new", "--json")
    assert [(one["session"], one["parameter"]) for one in shown["posteriors"]][:5] == [
        *(("old", name) for name in ("m1", "m2", "b1", "b2")),
        ("new", "m1"),
    ]
    assert "The posteriors disagree in" in Path(shown["page"]).read_text()

    assert "udr knows no posterior" in refused(2, *run, "--method", "udr", "--start-from", "old")
    assert old.run_iteration().number == 2  # from now on its posterior is another one
    assert "the posterior that it started from has changed" in refused(2, "run-iteration", "--session", "new", "--yes")


@pytest.mark.long
def test_methods_are_compared_on_recorded_trials_with_a_control(tmp_path, refused, printed):
    folder = write_tables(tmp_path / "swings", 24)
    run = ["benchmark", "--task", "pendulum", "--recorded", str(folder), "--budget", "4", "--seeds", "2", "--json"]
    methods = ["adaptsim", "random", "udr", "best-action", "permuted", "permuted-udr"]
    first = printed(*run, "--methods", ",".join(methods))
    rewards = {name: [row["reward"] for row in first["rows"] if row["method"] == name] for name in methods}
    for name in methods[:3]:
        assert all(best >= mine for best, mine in zip(rewards["best-action"], rewards[name], strict=True))
    assert {row["target"] for row in first["rows"]} == {"swings"}
    assert "leave out --lab" in refused(2, *run, "--methods", "adaptsim", "--lab")


def not_asked(requests: Requests) -> Rollouts:
    raise AssertionError("nothing is simulated before a policy is wanted")


@pytest.fixture
def by_naf(tmp_path) -> Checkpoint:
    """A checkpoint of scooping that was made without an emulator."""
    task = get_task("scooping")
    facts = naf_facts(NafSolver(task, not_asked, rules_of(task, 0.1), NafMemory(task), 1.5))
    folder = save_checkpoint(
        task, tmp_path / "naf", None, tensors_of({"iteration": new_policy(task, "iteration", 0)}), facts
    )
    return load_checkpoint(task, str(folder))


def test_a_checkpoint_made_with_naf_goes_on_with_it(by_naf, tmp_path):
    for name in ("", "naf"):
        with solver_of(by_naf, name, 1, tmp_path / "session") as (policies, expectations):
            assert isinstance(policies, NafSolver)
            assert policies.rules.first_budget == 120
            assert expectations.misfit_limit == 1.5
    with pytest.raises(UsageError, match="emulator"), solver_of(by_naf, "emulator", 1, tmp_path):
        pass


def test_beside_naf_an_emulator_still_tells_what_to_expect(tmp_path):
    checkpoint = load_checkpoint(get_task("scooping"))
    with solver_of(checkpoint, "naf", 1, tmp_path) as (policies, expectations):
        assert isinstance(policies, NafSolver)
        assert expectations is checkpoint.solver
    with solver_of(checkpoint, "", 1, tmp_path) as (policies, expectations):
        assert policies is expectations is checkpoint.solver


def test_an_exact_task_has_its_own(tmp_path):
    checkpoint, folder = load_checkpoint(get_task("pendulum")), tmp_path / "policies"
    with solver_of(checkpoint, "", 1, folder) as (policies, expectations):
        assert policies is expectations is checkpoint.solver
    with pytest.raises(UnknownName, match=r"pendulum .*naf"), solver_of(checkpoint, "naf", 1, folder):
        pass
    with pytest.raises(UsageError, match="emulator, naf"), solver_of(checkpoint, "lqr", 1, folder):
        pass
    assert not folder.exists()
