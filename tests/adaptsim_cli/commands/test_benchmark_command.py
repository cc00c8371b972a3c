"""`adaptsim benchmark` and `adaptsim world-tables`: from the command line to page, CSV and JSON."""

import csv
import json
from pathlib import Path

import pytest

from adaptsim_cli.commands.app import run
from adaptsim_cli.errors import UsageError
from adaptsim_cli.research.working import working_in
from sim.adaptation.checkpoint import save_checkpoint
from sim.adaptation.reward_table import RewardTableSettings, tabulate_rewards
from sim.rollouts.shares import Share
from sim.tasks import get_task
from sim.tasks.own_object import OwnObject, as_toml, with_ranges

PENDULUM = ["benchmark", "--task", "pendulum", "--targets", "wd,ood-1", "--budget", "4", "--seeds", "2"]


@pytest.fixture(autouse=True)
def home(place, monkeypatch):
    monkeypatch.setenv("ADAPTSIM_WORKERS", "1")
    return place.parent / "home"


def said(capsys):
    captured = capsys.readouterr()
    return captured.out, captured.err


@pytest.mark.long
def test_it_compares_writes_everything_down_and_goes_on(capsys, home):
    assert run([*PENDULUM, "--methods", "udr,random,oracle,best-action", "--json"]) == 0
    out, err = said(capsys)
    found = json.loads(out)
    assert len(found["rows"]) == 2 * 4 * 2
    assert found["rows"][0].keys() >= {
        "task", "target", "method", "seed", "reward", "ci95", "real_trials", "simulations", "wall_s",
    }  # fmt: skip
    by_name = {m["method"]: m for m in found["summary"][0]["methods"]}
    assert by_name["best-action"]["reward"] == pytest.approx(1.0)
    assert by_name["udr"]["reward"] < by_name["oracle"]["reward"]
    assert "named: 2 worlds, 2 seeds, 2 with a gap between oracle and udr" in err
    folder = home / "data/benchmarks"
    (page,) = folder.glob("pendulum-budget4-*/report.html")
    assert str(page) == found["report"]
    text = page.read_text()
    assert text.count("<svg") == 2
    assert "Worlds with a gap: wd, ood-1." in text
    with (page.parent / "rows.csv").open() as file:
        table = list(csv.DictReader(file))
    assert len(table) == 16
    assert float(table[0]["reward"]) == found["rows"][0]["reward"]
    nothing = {"version": 1, "recorded": None, "held_out": None}
    assert nothing | json.loads((page.parent / "benchmark.json").read_text()) == found

    assert run([*PENDULUM, "--methods", "udr,random,bo-prior", "--json"]) == 0
    out, err = said(capsys)
    again = json.loads(out)
    assert "sessions: 60 % (8 of 12)" in err
    kept = {(r["target"], r["method"], r["seed"]): r for r in found["rows"]}
    shared = [r for r in again["rows"] if r["method"] != "bo-prior"]
    assert shared == [kept[r["target"], r["method"], r["seed"]] for r in shared]


@pytest.mark.long
@pytest.mark.parametrize("flags", [[], ["--fresh", "4"]])
def test_it_says_where_trials_come_from(capsys, flags):
    assert run([*PENDULUM, "--methods", "random", *flags, "--json"]) == 0
    assert json.loads(said(capsys)[0])["trials"] == "simulated"


def test_what_cannot_be_compared_is_said_before_anything_runs(capsys, home):
    for flags, code, message in (
        (["--methods", "udr,magic"], 2, "--methods magic: choose all, or any of adaptsim"),
        (["--methods", ","], 2, "--methods is empty"),
        (["--targets", "marsh"], 2, "no world 'marsh' for pendulum"),
        (["--budget", "1"], 2, "a budget of 1 trials is less than one iteration of pendulum"),
        (["--checkpoints", "nowhere"], 8, "no checkpoint 'nowhere' for pendulum"),
    ):
        assert run([*PENDULUM, "--methods", "udr", *flags]) == code
        assert message in " ".join(said(capsys)[1].split())
    assert not (home / "data/benchmarks").exists()


@pytest.mark.long
@pytest.mark.parametrize("asked", [[], ["--checkpoints", "checkpoint"]])
def test_methods_use_the_checkpoint_of_an_own_object_and_worlds_stay_the_same(asked, capsys, home):
    """UDR's policy is the one for the mean of the object's ranges, which are those of ood-2."""
    own = OwnObject("pendulum", "rod", {"m1": (0.45, 0.55), "m2": (1.75, 1.85)})
    task = with_ranges(get_task("pendulum"), own)
    Path("rod.toml").write_text(as_toml(task, own))
    folder = Path("checkpoint") if asked else home / "data/pretraining/rod/checkpoint"
    table = tabulate_rewards(task.exact(task), 0, RewardTableSettings(candidates=4, truths=8, contexts=2))
    save_checkpoint(task, folder, None, {}, {"seed": 0, "simulations": 0}, table)
    line = [
        "benchmark",
        "--task",
        "pendulum",
        "--targets",
        "ood-2",
        "--budget",
        "2",
        "--methods",
        "udr",
        "--seeds",
        "1",
    ]
    rewards = []
    for more in ([], ["--object", "rod.toml", *asked]):
        assert run([*line, "--seeds", "1", *more, "--json"]) == 0
        (row,) = json.loads(said(capsys)[0])["rows"]
        rewards.append(row["reward"])
    assert rewards[1] > rewards[0] + 0.1


def test_more_than_one_seed_is_refused_where_every_seed_gives_the_same_session(capsys):
    asked = ["benchmark", "--task", "pendulum", "--targets", "wd", "--budget", "2", "--methods", "adaptsim,oracle"]
    assert run([*asked, "--seeds", "2"]) == 2
    assert "It is deterministic: one session is enough" in said(capsys)[1]


@pytest.mark.long
def test_one_session_is_the_default_there_and_it_has_no_interval(capsys):
    asked = ["benchmark", "--task", "pendulum", "--targets", "wd", "--budget", "2", "--methods"]
    assert run([*asked, "adaptsim"]) == 0
    out = said(capsys)[0]
    assert "1 world, 1 seed" in out
    assert " to " not in next(line for line in out.splitlines() if line.split()[:1] == ["adaptsim"])
    assert run([*asked, "adaptsim,random", "--seeds", "2"]) == 0
    assert "every seed gave adaptsim the same sessions" in " ".join(said(capsys)[0].split())


def test_a_missing_extra_gives_its_install_line(capsys, monkeypatch):
    monkeypatch.setattr("sim.research.methods.search.find_spec", lambda name: None)
    assert run([*PENDULUM, "--methods", "all"]) == 3
    assert "is not installed: pip install" in said(capsys)[1]


@pytest.mark.long
def test_tables_are_made_for_contact_tasks_alone_and_missing_ones_name_the_command(capsys):
    assert run(["world-tables", "--task", "pendulum"]) == 2
    assert "pendulum needs no tables" in said(capsys)[1]
    assert run(["benchmark", "--task", "pushing", "--targets", "wd", "--methods", "udr"]) == 8
    assert "make it with `adaptsim world-tables --task pushing --targets wd`" in said(capsys)[1]


@pytest.mark.slow
def test_a_table_of_pushing_is_made_and_sessions_are_looked_up_in_it(capsys):
    """A table far too small for anything but this."""
    assert run(["world-tables", "--task", "pushing", "--targets", "wd", "--rollouts", "16", "--json"]) == 0
    (made,) = json.loads(said(capsys)[0])["tables"]
    assert (made["set"], made["world"], made["rollouts"]) == ("named", "wd", 16)
    flags = ["--targets", "wd", "--methods", "adaptsim,best-action", "--seeds", "1", "--budget", "4", "--json"]
    assert run(["benchmark", "--task", "pushing", *flags]) == 0
    found = json.loads(said(capsys)[0])
    assert [row["method"] for row in found["rows"]] == ["adaptsim", "best-action"]
    assert found["trials"] == "tables"
    assert found["rows"][0]["real_trials"] == 4
    assert all(0.0 <= row["reward"] <= 1.0 for row in found["rows"])
    assert run(["world-tables", "--task", "pushing", "--targets", "wd", "--rollouts", "32"]) == 8
    assert "holds a table with a different size" in said(capsys)[1]


@pytest.mark.long
def test_shares_are_joined_by_the_same_command_without_share(capsys, home):
    flags = ["--methods", "udr,random,oracle"]
    assert run([*PENDULUM, *flags, "--json", "--out", "whole"]) == 0
    whole = json.loads(said(capsys)[0])["rows"]
    for number in (1, 2, 3):
        assert run([*PENDULUM, *flags, "--share", f"{number}/3", "--out", "shared"]) == 0
        assert f"Share {number}/3 is complete: 4 sessions in" in " ".join(said(capsys)[0].split())
    assert run([*PENDULUM, *flags, "--json", "--out", "shared"]) == 0
    out, err = said(capsys)
    assert "sessions: 100 % (12 of 12)" in err
    timed = ("wall_s", "cpu_s")
    assert [{k: v for k, v in row.items() if k not in timed} for row in json.loads(out)["rows"]] == [
        {k: v for k, v in row.items() if k not in timed} for row in whole
    ]


@pytest.mark.parametrize("share", ["0/2", "3/2", "2", "a/b", "1/0"])
def test_a_share_that_is_none_is_refused(share, capsys):
    assert run([*PENDULUM, "--methods", "udr", "--share", share]) == 2
    assert f"--share {share}: write K/N with K from 1 to N, for example 2/8" in said(capsys)[1]


def test_a_share_has_no_json_and_a_scheduler_no_number_of_processes(capsys):
    assert run([*PENDULUM, "--methods", "udr", "--share", "1/2", "--json"]) == 2
    assert "--share computes a part and has no result as JSON: leave --json out" in said(capsys)[1]
    assert run([*PENDULUM, "--methods", "udr", "--scheduler", "tcp://127.0.0.1:9", "--workers", "2"]) == 2
    assert "--workers counts processes of this computer" in said(capsys)[1]


def test_shares_run_beside_each_other_and_neither_twice_nor_beside_the_whole(tmp_path):
    folder = tmp_path / "work"
    busy = "another benchmark is running in {}"
    with working_in(folder, busy, Share(1, 2)), working_in(folder, busy, Share(2, 2)):
        twice = r"share 2/2 is running in .*give this one another number"
        with pytest.raises(UsageError, match=twice), working_in(folder, busy, Share(2, 2)):
            pass
        with pytest.raises(UsageError, match="another benchmark is running in"), working_in(folder, busy):
            pass
    alone, refused = working_in(folder, busy), pytest.raises(UsageError, match="another benchmark")
    with alone, refused, working_in(folder, busy, Share(1, 2)):
        pass
