"""Sessions in the real packages of W&B (offline) and MLflow: `make test-extra`. Neither needs a network."""

from __future__ import annotations

from pathlib import Path

import pytest
from toy_session import run

from adaptsim_cli.session.history import played_of, results_of
from adaptsim_cli.session.store import SessionStore
from adaptsim_cli.show.loggers.feed import logged_again

pytestmark = pytest.mark.extra


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> SessionStore:
    return run(tmp_path_factory.mktemp("logged"))


def test_wandb_keeps_a_run_on_the_disk(store: SessionStore, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import json  # noqa: PLC0415 - collected without the extra too

    from wandb.proto import wandb_internal_pb2  # noqa: PLC0415
    from wandb.sdk.internal.datastore import DataStore  # noqa: PLC0415

    for name in ("WANDB_MODE", "WANDB_PROJECT"):
        monkeypatch.delenv(name, raising=False)
    folder = logged_again("wandb", tmp_path, store)
    (file,) = folder.glob("wandb/offline-run-*/*.wandb")
    reader, rows, summary = DataStore(), list[dict[str, object]](), dict[str, object]()
    reader.open_for_scan(str(file))
    while (content := reader.scan_data()) is not None:
        record = wandb_internal_pb2.Record.FromString(content)
        row = {item.key or "/".join(item.nested_key): json.loads(item.value_json) for item in record.history.item}
        rows += [row] if row else []
        summary |= {one.key or "/".join(one.nested_key): json.loads(one.value_json) for one in record.summary.update}
    rewards = [(row["trial"], row["reward"]) for row in rows if "reward" in row]
    assert rewards == [(one.trial, pytest.approx(one.reward)) for one in played_of(store)]
    assert len([row for row in rows if "picture/film" in row]) == len(rewards)
    assert str(summary["verdict"]).split(":")[0]


def test_mlflow_keeps_a_run_in_its_own_file(
    store: SessionStore, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from mlflow import MlflowClient  # noqa: PLC0415 - collected without the extra too

    monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)
    folder = logged_again("mlflow", tmp_path, store)
    client = MlflowClient(tracking_uri=f"sqlite:///{folder / 'mlflow.db'}")
    experiment = client.get_experiment_by_name("adaptsim")
    (kept,) = client.search_runs([experiment.experiment_id])
    assert (kept.info.run_name, kept.info.status) == (store.facts.name, "FINISHED")
    rewards = [(one.step, one.value) for one in client.get_metric_history(kept.info.run_id, "reward")]
    assert rewards == [(one.trial, pytest.approx(one.reward)) for one in played_of(store)]
    assert kept.data.metrics["best/reward"] == pytest.approx(results_of(store)[-1].best.mean_reward)
    assert kept.data.tags["verdict"] and kept.data.params["method"] == store.facts.method
    films = client.list_artifacts(kept.info.run_id, "picture/film")
    assert len(films) == len(rewards)
