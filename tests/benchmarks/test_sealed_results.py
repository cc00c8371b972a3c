"""Stored results of a sealed benchmark, and their page."""

import json

import numpy as np
import own_actions
import pytest
import sealed

from sim.storage.files import write_toml

SEAL = {"seed": 7, "rule": "drawn", "drawn": "then", "commit": "abc", "opened": "later"}
ENTRIES = {"udr": 0.5, "adaptsim": 0.9, "best-action": 0.95}


def run_folder(folder, worlds, missing=()):
    plan = {"task": "pendulum", "conditions": {"budget": 2}, "checkpoints": ["0" * 64]}
    write_toml(folder / "benchmark.toml", {**plan, "sealed": {"seed": 7, "commit": "abc"}})
    write_toml(folder / "seal.toml", SEAL)
    for number in range(worlds):
        for method, reward in ENTRIES.items():
            if (number, method) in missing:
                continue
            path = folder / f"rows/sealed/drawn-7-{number}-0/{method}-0.json"
            path.parent.mkdir(parents=True, exist_ok=True)
            row = {"target": f"drawn-7-{number}", "method": method, "seed": 0, "reward": reward, "shown": 0.5}
            path.write_text(json.dumps(row))
    return sealed.stored(folder, folder / "seal.toml")


def test_the_first_worlds_are_kept_up_to_one_in_which_an_entry_is_missing(tmp_path):
    whole = run_folder(tmp_path / "whole", 3)
    assert (whole["worlds"], len(whole["rows"]), whole["commit"], whole["trials"]) == (3, 9, "abc", 2)
    stopped = run_folder(tmp_path / "stopped", 3, {(1, "adaptsim")})
    assert stopped["worlds"] == 1
    assert {row[0] for row in stopped["rows"]} == {"drawn-7-0"}


def test_results_of_another_seal_are_refused(tmp_path):
    run_folder(tmp_path, 1)
    write_toml(tmp_path / "seal.toml", {**SEAL, "commit": "other"})
    with pytest.raises(SystemExit, match="its seed or commit differs"):
        sealed.stored(tmp_path, tmp_path / "seal.toml")


def test_trainings_share_the_worlds_and_entries_that_all_of_them_have(tmp_path):
    first, second = run_folder(tmp_path / "first", 3), run_folder(tmp_path / "second", 2)
    second["rows"] = [row for row in second["rows"] if row[1] != "best-action"]
    both = sealed.together([first, second])
    assert (both["worlds"], len(both["checkpoints"]), len(both["rows"])) == (2, 2, 8)
    assert {(row[1], row[2]) for row in both["rows"]} == {(e, k) for e in ("udr", "adaptsim") for k in (0, 1)}
    with pytest.raises(SystemExit, match="differ in more than their checkpoints"):
        sealed.together([first, {**second, "trials": 4}])


def test_a_fixed_rule_is_scored_in_truths_that_did_not_choose_it():
    rng = np.random.default_rng(0)
    noise = rng.random((200, 50, 1))  # every action is equally good: choosing one by its luck gains nothing
    found = own_actions.summary(noise)
    assert found["fixed"] == pytest.approx(0.5, abs=0.05)
    assert found["own"] > 0.95
    assert found["in_need"] > 150
    same = np.tile(np.linspace(0.0, 0.8, 50)[None, :, None], (200, 1, 1))
    assert own_actions.summary(same) == {"truths": 200, "fixed": 0.8, "own": 0.8, "in_need": 0}
