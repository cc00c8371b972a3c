"""The best policy of a session by its name, and the rollouts that it makes."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from adaptsim_cli import api
from adaptsim_cli.commands import app
from adaptsim_cli.errors import UsageError
from adaptsim_cli.session import best_scene, formats, history
from adaptsim_cli.session.best import TaskPolicy
from adaptsim_cli.session.hindsight import Hindsight
from hw.types import Array
from sim.adaptation.posterior import Posterior
from sim.errors import OutOfRange
from sim.tasks import get_task
from sim.tasks.task import SolvedPolicy

NAME = "study"


@pytest.fixture(scope="module")
def home(tmp_path_factory) -> Path:
    home = tmp_path_factory.mktemp("best")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ADAPTSIM_HOME", str(home))
        for name, method in ((NAME, "adaptsim"), ("own", "learn-in-target")):
            api.begin("pendulum", name=name, method=method).run_iteration()
        api.begin("pendulum", name="empty")
    return home


@pytest.fixture(autouse=True)
def there(home, monkeypatch) -> None:
    monkeypatch.setenv("ADAPTSIM_HOME", str(home))


@pytest.mark.long
def test_the_best_policy_runs_and_is_exported_by_name(home, tmp_path, printed):
    session = api.open_session(NAME)
    record = printed("rollout", "--session", NAME, "--best", "--yes", "--json")
    assert record["params"] == session.iterations[-1].best.params
    assert list(record["action"].values()) == session.best_policy()(np.zeros(0)).tolist()

    file = tmp_path / "policy.json"
    assert app.run(["sessions", "policy", NAME, "--out", str(file)]) == 0
    policy = json.loads(file.read_text())
    assert policy["actions"] == [list(record["action"].values())]
    assert [d["name"] for d in policy["quantities"]["action"]] == list(record["action"])
    assert policy["quantities"]["parameters"][0]["unit"] == "kg"


INEXPRESSIBLE = """task = "pendulum"
description = "The inner joint is more viscous than any that a fit may try, so every trial changes the policy."

[params]
m1 = 1.5
m2 = 1.5
b1 = 70.0
b2 = 2.0
"""


@pytest.mark.long
def test_a_best_policy_is_confirmed_by_trials_that_its_report_calls_measured(tmp_path, capfd, refused):
    world = tmp_path / "viscous.toml"
    world.write_text(INEXPRESSIBLE)
    session = api.begin("pendulum", name="viscous", world=str(world))
    session.run_iteration()
    assert "predicted from 2 trials, not yet tried" in session.report().read_text(encoding="utf-8")
    assert app.run(["rollout", "--session", "viscous", "--best", "--trials", "2", "--yes", "--json"]) == 0
    told = [json.loads(line) for line in capfd.readouterr().out.splitlines()]
    assert [(one["session"], one["iterations"]) for one in told] == [("viscous", 1)] * 2
    page = session.report().read_text(encoding="utf-8")
    assert "trials after the session" in page
    assert "Best policy: tried in 2 trials after the session: mean reward" in page
    assert "not yet tried" not in page
    session.run_iteration()  # another policy, for which the trials of the earlier one do not count
    page = session.report().read_text(encoding="utf-8")
    assert "predicted from 4 trials, not yet tried" in page
    assert "trials after the session" not in page
    assert "--session NAME --best --trials" in refused(2, "rollout", "--task", "pendulum", "--trials", "2", "--yes")


def test_a_policy_that_follows_from_trials_runs_by_name_too(printed):
    record = printed("rollout", "--session", "own", "--best", "--yes", "--json")
    assert list(record["action"].values()) == api.open_session("own").best_policy()(np.zeros(0)).tolist()


def test_a_task_without_an_arm_has_no_scene(tmp_path, refused):
    (tmp_path / "out").mkdir()
    for kind in ("sdf", "mjcf"):
        assert "pendulum has no motion for a robot arm" in refused(
            2, "sessions", "export", NAME, "--format", kind, "--out", str(tmp_path / "out" / "scene")
        )
    assert not list((tmp_path / "out").iterdir())


def test_a_policy_takes_lists_and_refuses_wrong_contexts():
    task = get_task("pushing")
    asked: list[Array] = []

    def acting(context: Array) -> Array:
        asked.append(context)
        return np.array([0.1, 0.5])

    policy = TaskPolicy("mine", task, cast(SolvedPolicy, acting))
    assert policy([0.85, 0.0]).tolist() == [0.1, 0.5]
    assert asked[0].tolist() == [0.85, 0.0]
    assert repr(policy) == "<best policy of mine: (goal_x [m], goal_bearing [rad]) -> (yaw [rad], speed [m/s])>"
    with pytest.raises(OutOfRange, match=r"has 2 values .*, not 3"):
        policy([0.85, 0.0, 0.1])
    with pytest.raises(OutOfRange, match="850 lies outside"):
        policy([850, 0.0])


def test_a_rollout_ends_with_its_page(capfd):
    assert app.run(["rollout", "--task", "pendulum", "--yes"]) == 0
    html = Path(capfd.readouterr().out.split("Report: ")[1].splitlines()[0]).read_text()
    assert "method rollout · SIMULATED target, world wd" in html
    assert html.count('class="track c0') >= 2
    assert "No iteration is complete yet" not in html
    assert "http" not in html


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--best", "--yes"], "go together"),
        (["--session", NAME, "--yes"], "go together"),
        (["--session", NAME, "--best", "--param", "m1=1"], "leave out --task and --param"),
        (["--session", "empty", "--best", "--yes"], "no complete iteration yet"),
    ],
)
def test_what_makes_no_sense_is_refused(arguments, message, capfd):
    assert app.run(["rollout", *arguments]) in (2, 8)
    assert message in " ".join(capfd.readouterr().err.split())


PUSHING = get_task("pushing")
LOW, HIGH = (np.array([0.1, 1e4, 0.3, 0.0]), np.array([0.2, 1e6, 0.5, 0.04]))
CONTEXT, ACTION = np.array([0.9, 0.05]), np.array([0.1, 0.6])


@pytest.fixture
def store(monkeypatch) -> SimpleNamespace:
    spread = 1.0 + 1e-9 * np.arange(24)[:, None]  # different samples, or the posterior would count as collapsed
    samples = np.where(np.arange(24)[:, None] % 2, HIGH * (2.0 - spread), LOW * spread)
    known = Posterior(PUSHING.margin, samples, np.full(24, 1.0 / 24))
    found = SimpleNamespace(
        checkpoint=SimpleNamespace(solver=SimpleNamespace(task=PUSHING)), posterior=lambda store: known
    )
    monkeypatch.setattr(Hindsight, "of", lambda store: found)
    monkeypatch.setattr(best_scene, "policy_of_session", lambda store, checkpoint: lambda context: ACTION)
    monkeypatch.setattr(best_scene, "trials_of", lambda store: [SimpleNamespace(context_array=CONTEXT)])
    monkeypatch.setattr(history, "played_of", lambda store: [SimpleNamespace(context_array=CONTEXT)])
    return SimpleNamespace(facts=SimpleNamespace(name="s", units={}, curves={}))


def test_it_holds_the_mean_the_interval_and_the_policys_action(store, tmp_path):
    (file, trial) = formats.export(store, "sdf", tmp_path / "adapted", best_scene.scene_files)
    told, text = json.loads(trial.read_text()), file.read_text()
    assert told["parameters"] == pytest.approx({"mu": 0.15, "e": 1e5, "mu_p": 0.4, "y_p": 0.02})
    assert told["interval"]["mu"] == pytest.approx([0.1, 0.2])
    assert told["action"] == {"yaw": 0.1, "speed": 0.6}
    assert "table friction mu = 0.15, 90 % of the posterior between 0.1 and 0.2" in text
    assert f"<drake:hydroelastic_modulus>{told['parameters']['e']!r}<" in text
    expected = PUSHING.simulate(np.array(list(told["parameters"].values())), CONTEXT, ACTION, np.zeros(2))
    assert np.linalg.norm(np.array(told["end"]["position_m"]) - expected.state[-1]) < 1e-6


def test_nothing_is_overwritten(store, tmp_path):
    with pytest.raises(UsageError, match="exists already: name another --out"):
        formats.export(store, "sdf", tmp_path, best_scene.scene_files)
