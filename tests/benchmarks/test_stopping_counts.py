"""Base rates of the stop rule, counted from stored iterations."""

import pytest
import stopping
from stopping import AfterIteration, counts, read, sessions_of, write


def session(world, rewards, earned, predicted=0.8, hopeless=False):
    rows = enumerate(zip(rewards, earned, strict=True), start=1)
    return [
        AfterIteration("pushing", world, 0, number, predicted, trial, 0.75, 0.5, 0.9, hopeless, reward)
        for number, (reward, trial) in rows
    ]


@pytest.fixture
def stored(tmp_path, monkeypatch):
    monkeypatch.setattr(stopping, "STORED", tmp_path / "stopping.csv")
    gains_when_refuted = session("a", [0.5, 0.5, 0.9], [0.1, 0.2, 0.9])
    confirmed = session("b", [0.7, 0.8, 0.7], [0.7, 0.8, 0.7])
    write([*gains_when_refuted, *confirmed, *session("c", [0.1, 0.9], [0.1, 0.1], hopeless=True)])
    return sessions_of("pushing", read())


def test_stored_iterations_come_back_as_sessions(stored):
    assert [(one[0].world, len(one)) for one in stored] == [("a", 3), ("b", 3), ("c", 2)]
    assert sessions_of("scooping", read()) == []


def test_a_policy_counts_as_refuted_from_the_second_iteration_on(stored):
    assert [one.is_refuted for one in stored[0]] == [False, True, False]
    assert not any(one.is_refuted for one in stored[1])


def test_gains_and_losses_are_counted_apart_for_refuted_policies_and_without_hopeless_sessions(stored):
    lines = list(counts(stored))
    assert "| 1 | all | 2 | 1 | 0 |" in lines
    assert "| 2 | all | 2 | 1 | 1 |" in lines
    assert "| 2 and later | policy refuted | 1 | 1 | 0 |" in lines
    assert "| 1 | policy refuted | 0 | 0 | 0 |" in lines
    assert any(line.startswith("hopeless: said in 1 of 3 worlds, in 1 that earned 0.3") for line in lines)
