"""A session that begins with another's posterior, and the comparison of posteriors."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from recordings import write_tables

from adaptsim_cli import api, app
from adaptsim_cli.outputs.sessions import ParameterBelief
from adaptsim_cli.report.comparison import disagreements
from sim.adaptation.reward_table import RewardTable, weighed


def believed(session: str, low: float, high: float, parameter: str = "mu") -> ParameterBelief:
    return ParameterBelief(session=session, parameter=parameter, unit="", low=low, median=0.5 * (low + high), high=high)


def test_posteriors_disagree_where_their_intervals_have_nothing_in_common() -> None:
    apart = [believed("a", 0.1, 0.2), believed("b", 0.3, 0.4), believed("c", 0.15, 0.35)]
    assert disagreements(apart) == ("The posteriors disagree in mu: a has 0.1 to 0.2, b 0.3 to 0.4 (90 %).",)
    assert disagreements([believed("a", 0.1, 0.2), believed("b", 0.2, 0.3)]) == (
        "The posteriors disagree in no parameter: all 90 % intervals overlap.",
    )
    assert disagreements(apart[:1]) == ()


def test_prospects_weighed_by_a_posterior_repeat_its_truths_and_keep_a_tenth_of_the_others() -> None:
    truths = np.arange(100.0)[:, None]
    weights = np.zeros(100)
    weights[7] = 1.0
    found = weighed(RewardTable(truths[:3], truths, np.arange(300.0).reshape(3, 100)), weights)
    assert 0.88 < (found.truths == 7.0).mean() < 0.93
    assert len(np.unique(found.truths)) == pytest.approx(10, abs=2)
    assert found.rewards[1].tolist() == (found.truths[:, 0] + 100.0).tolist()


@pytest.mark.long
def test_a_session_begins_with_the_posterior_of_another_and_comparing_them_names_parameters(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("ADAPTSIM_HOME", str(tmp_path))
    run = ["run-iteration", "--task", "pendulum", "--yes", "--world", "wd"]
    assert app.run([*run, "--session", "old"]) == 0
    old, new = api.open_session("old"), api.begin("pendulum", start_from="old", name="new")
    before, after = old.posterior(0).quantiles((0.05, 0.95)), new.posterior(0).quantiles((0.05, 0.95))
    assert (after[1] - after[0] <= before[1] - before[0] + 1e-9).all()
    assert (after[1] - after[0] < 0.7 * (before[1] - before[0])).any()
    new.run_iteration()
    assert new.facts.start_from == "old"
    assert "the posterior of session old" in (new.folder / "report.html").read_text()

    capsys.readouterr()
    assert app.run(["compare", "old", "new", "--json"]) == 0
    shown = json.loads(capsys.readouterr().out)
    assert [(one["session"], one["parameter"]) for one in shown["posteriors"]][:5] == [
        *(("old", name) for name in ("m1", "m2", "b1", "b2")),
        ("new", "m1"),
    ]
    assert "The posteriors disagree in" in Path(shown["page"]).read_text()

    assert app.run([*run, "--method", "udr", "--start-from", "old"]) == 2
    assert "udr knows no posterior" in capsys.readouterr().err
    assert old.run_iteration().number == 2  # from now on its posterior is another one
    assert app.run(["run-iteration", "--session", "new", "--yes"]) == 2
    assert "the posterior that it started from has changed" in capsys.readouterr().err


@pytest.mark.long
def test_methods_are_compared_on_recorded_trials_with_a_control(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("ADAPTSIM_HOME", str(tmp_path))
    folder = write_tables(tmp_path / "swings", 24)
    run = ["benchmark", "--task", "pendulum", "--recorded", str(folder), "--budget", "4", "--seeds", "2", "--json"]
    methods = ["adaptsim", "random", "udr", "best-action", "permuted", "permuted-udr"]
    assert app.run([*run, "--methods", ",".join(methods)]) == 0
    first = json.loads(capsys.readouterr().out)
    rewards = {name: [row["reward"] for row in first["rows"] if row["method"] == name] for name in methods}
    for name in methods[:3]:
        assert all(best >= mine for best, mine in zip(rewards["best-action"], rewards[name], strict=True))
    assert {row["target"] for row in first["rows"]} == {"swings"}
    assert app.run([*run, "--methods", "adaptsim", "--lab"]) == 2
    assert "leave out --lab" in capsys.readouterr().err
