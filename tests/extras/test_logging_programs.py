"""Sessions in the real packages of W&B (offline) and MLflow: `make test-extra`. Neither needs a network."""

from __future__ import annotations

from collections.abc import Iterator
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

    import wandb  # noqa: PLC0415
    from wandb.proto import wandb_internal_pb2  # noqa: PLC0415

    for name in ("WANDB_MODE", "WANDB_PROJECT"):
        monkeypatch.delenv(name, raising=False)
    folder = logged_again("wandb", tmp_path, store)
    wandb.teardown()  # its own process writes the file; this waits for its end
    (file,) = folder.glob("wandb/offline-run-*/*.wandb")
    rows, summary = list[dict[str, object]](), dict[str, object]()
    for content in log_records(file.read_bytes()):
        record = wandb_internal_pb2.Record.FromString(content)
        row = {item.key or "/".join(item.nested_key): json.loads(item.value_json) for item in record.history.item}
        rows += [row] if row else []
        summary |= {one.key or "/".join(one.nested_key): json.loads(one.value_json) for one in record.summary.update}
    rewards = [(row["trial"], row["reward"]) for row in rows if "reward" in row]
    assert rewards == [(one.trial, pytest.approx(one.reward)) for one in played_of(store)]
    films = [row["trial"] for row in rows if any(name.startswith("picture/film") for name in row)]
    assert films == [one.trial for one in played_of(store)]
    assert str(summary["verdict"]).split(":")[0]


def test_mlflow_keeps_a_run_in_a_folder_of_its_own(
    store: SessionStore, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from mlflow import MlflowClient  # noqa: PLC0415 - collected without the extra too

    monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)
    folder = logged_again("mlflow", tmp_path, store)
    client = MlflowClient(tracking_uri=folder.as_uri())
    experiment = client.get_experiment_by_name("adaptsim")
    (kept,) = client.search_runs([experiment.experiment_id])
    assert (kept.info.run_name, kept.info.status) == (store.facts.name, "FINISHED")
    rewards = [(one.step, one.value) for one in client.get_metric_history(kept.info.run_id, "reward")]
    assert rewards == [(one.trial, pytest.approx(one.reward)) for one in played_of(store)]
    assert kept.data.metrics["best/reward"] == pytest.approx(results_of(store)[-1].best.mean_reward)
    assert kept.data.tags["verdict"] and kept.data.params["method"] == store.facts.method
    films = client.list_artifacts(kept.info.run_id, "picture/film")
    assert len(films) == len(rewards)


def log_records(content: bytes) -> Iterator[bytes]:
    """The records of W&B's file, a log of LevelDB: blocks of 32 KiB with parts of checksum, length, type and content.

    Types: 1 whole, 2 first, 3 middle, 4 last. The file begins with 7 bytes of its own.
    """
    at, record = 7, b""
    while at + 7 <= len(content):
        if 32768 - at % 32768 < 7:
            at += 32768 - at % 32768
        size, kind = int.from_bytes(content[at + 4 : at + 6], "little"), content[at + 6]
        record += content[at + 7 : at + 7 + size]
        at += 7 + size
        if kind in (1, 4):
            yield record
            record = b""
