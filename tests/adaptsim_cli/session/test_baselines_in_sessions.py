"""Every method that needs more than a checkpoint also runs as a session, in the same format."""

import json

import pytest

from adaptsim_cli.app import run


@pytest.mark.long
@pytest.mark.parametrize("method", ["learn-in-target", "bo", "bo-prior", "sysid-bayes-point"])
def test_a_session_of_a_baseline_runs_and_continues(method, tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("ADAPTSIM_HOME", str(tmp_path))
    line = ["run-iteration", "--task", "pendulum", "--method", method, "--yes", "--json"]
    assert run(line) == 0
    first = json.loads(capsys.readouterr().out)
    assert run(line) == 0  # another process would do the same: nothing is kept but the session's folder
    second = json.loads(capsys.readouterr().out)
    assert (first["iteration"], second["iteration"]) == (1, 2)
    assert [p["params"] for p in second["particles"]] == [p["next_params"] for p in first["particles"]]
    assert all(0.0 <= t["reward"] <= 1.0 for p in second["particles"] for t in p["trials"])
