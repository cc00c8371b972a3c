"""The scene of a session is that at the posterior mean, with the action of its best policy."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from adaptsim_cli.errors import UsageError
from adaptsim_cli.session import exporting
from adaptsim_cli.wiring import best
from adaptsim_cli.wiring.hindsight import Hindsight
from sim.adaptation.posterior import Posterior
from sim.tasks import get_task

TASK = get_task("pushing")
LOW, HIGH = (np.array([0.1, 1e4, 0.3, 0.0]), np.array([0.2, 1e6, 0.5, 0.04]))
CONTEXT, ACTION = np.array([0.9, 0.05]), np.array([0.1, 0.6])


@pytest.fixture
def store(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    known = Posterior(TASK.margin, np.stack([LOW, HIGH]), np.array([0.5, 0.5]))
    found = SimpleNamespace(
        checkpoint=SimpleNamespace(solver=SimpleNamespace(task=TASK)), posterior=lambda store: known
    )
    monkeypatch.setattr(Hindsight, "of", lambda store: found)
    monkeypatch.setattr(best, "policy_of_session", lambda store, checkpoint: lambda context: ACTION)
    for module in (best, exporting):
        monkeypatch.setattr(module, "trials_of", lambda store: [SimpleNamespace(context_array=CONTEXT)])
    return SimpleNamespace(facts=SimpleNamespace(name="s", units={}, curves={}))


def test_it_holds_the_mean_the_interval_and_the_policys_action(store: SimpleNamespace, tmp_path: Path) -> None:
    (file, trial) = exporting.export(store, "sdf", tmp_path / "adapted", best.scene_files)  # type: ignore[arg-type]
    told, text = json.loads(trial.read_text()), file.read_text()
    assert told["parameters"] == pytest.approx({"mu": 0.15, "e": 1e5, "mu_p": 0.4, "y_p": 0.02})
    assert told["interval"]["mu"] == [0.1, 0.2]
    assert told["action"] == {"yaw": 0.1, "speed": 0.6}
    assert "table friction mu = 0.15, 90 % of the posterior between 0.1 and 0.2" in text
    assert f"<drake:hydroelastic_modulus>{told['parameters']['e']!r}<" in text
    expected = TASK.simulate(np.array(list(told["parameters"].values())), CONTEXT, ACTION, np.zeros(2))
    assert np.linalg.norm(np.array(told["end"]["position_m"]) - expected.state[-1]) < 1e-6


def test_nothing_is_overwritten(store: SimpleNamespace, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="exists already: name another --out"):
        exporting.export(store, "sdf", tmp_path, best.scene_files)  # type: ignore[arg-type]
