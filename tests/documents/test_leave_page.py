"""The programs of docs/guide/leave.md run, and end where the session predicts.

They parse the exported scenes by themselves: nothing of ours builds or steps them.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from documents import code_in

from adaptsim_cli.session.best import contexts_of
from sim.lab.scene_files import SceneTrial, as_mjcf, as_sdf
from sim.tasks import get_task

READ_POLICY, IN_DRAKE, IN_MUJOCO = code_in("docs/guide/leave.md", "python")
SEEDS = {"pushing": (0, 3), "scooping": (0, 1)}
"""Of the trials: pushed off the middle and toppled, missed and scooped."""


def drawn(name: str, seed: int) -> SceneTrial:
    task, rng = get_task(name), np.random.default_rng(seed)
    return SceneTrial(task, *(space.sample(rng, 1)[0] for space in (task.parameters, task.context, task.action)))


def run(code: str, files: dict[str, bytes], folder: Path) -> tuple[np.ndarray, np.ndarray]:
    """Where the object ends, and where it should, in a folder with these files."""
    folder.mkdir()
    for name, content in files.items():
        (folder / name).write_bytes(content)
    names: dict[str, object] = {}
    exec(code, names)
    return np.array(names["end_m"]), np.array(json.loads(files["trial.json"])["end"]["position_m"])


@pytest.mark.parametrize(("name", "seed"), [(name, seed) for name, seeds in SEEDS.items() for seed in seeds])
def test_drake_ends_within_a_millimetre_of_the_prediction(name, seed, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    trial = drawn(name, seed)
    end_m, wanted_m = run(IN_DRAKE, as_sdf(trial, {}, ["mu = 0.3"]), tmp_path / "adapted")
    expected = trial.task.simulate(trial.parameters, trial.context, trial.action, trial.nuisance)
    assert np.linalg.norm(end_m - wanted_m) < 1e-3
    assert np.linalg.norm(end_m[:2] - expected.state[-1, :2]) < 1e-3 or name == "scooping"  # carried on with the blade
    assert b"mu = 0.3" in (tmp_path / "adapted/scene.sdf").read_bytes()


@pytest.mark.long
@pytest.mark.parametrize(("name", "seed"), [("pushing", 4), ("scooping", 1)])
def test_mujoco_loads_the_scene_and_ends_near_our_own_rollout_in_it(name, seed, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    pytest.importorskip("mujoco")
    end_m, wanted_m = run(IN_MUJOCO, as_mjcf(drawn(name, seed), {}, ["mu = 0.3"]), tmp_path / "adapted-mujoco")
    assert np.linalg.norm(end_m - wanted_m) < 1e-3


def test_the_policy_is_read_in_ten_lines(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    task = get_task("pushing")
    contexts = contexts_of(task)
    described = {
        kind: [{"name": d.name, "low": d.low, "high": d.high} for d in space.dimensions]
        for kind, space in (("context", task.context), ("action", task.action))
    }
    actions = task.action.denormalise(0.2 + 0.5 * task.context.normalise(contexts))
    told = {"quantities": described, "contexts": contexts.tolist(), "actions": actions.tolist()}
    (tmp_path / "policy.json").write_text(json.dumps(told))
    names: dict[str, object] = {}
    exec(READ_POLICY, names)
    assert np.allclose(np.asarray(names["action"]), task.action.denormalise(np.full(2, 0.45)))
    assert len([line for line in READ_POLICY.splitlines() if line and "import" not in line]) <= 10
