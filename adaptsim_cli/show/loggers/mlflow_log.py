"""A session for MLflow: in a folder, or on your server.

The server is the one that MLFLOW_TRACKING_URI names.
"""

from __future__ import annotations

import os
import re
import shlex
from pathlib import Path
from typing import Any

from adaptsim_cli.show.loggers import Values, Words
from hw.extras import missing
from sim.errors import ExtraMissing

EXPERIMENT = "adaptsim"
_FORBIDDEN = re.compile(r"[^\w./ -]")
"""Characters that the name of a metric must not have."""


def open_logger(folder: Path, session: str, settings: Words) -> MlflowLog:
    """See `OpenLogger`."""
    try:
        from mlflow import MlflowClient
    except ImportError as error:
        raise ExtraMissing(missing("the log for MLflow", "mlflow", "mlflow")) from error
    server = os.environ.get("MLFLOW_TRACKING_URI")
    os.environ.setdefault("MLFLOW_ALLOW_FILE_STORE", "true")  # its slim package has no database
    client = MlflowClient(tracking_uri=server or folder.as_uri())
    existing = client.get_experiment_by_name(EXPERIMENT)
    experiment = client.create_experiment(EXPERIMENT) if existing is None else existing.experiment_id
    run = client.create_run(experiment, run_name=session)
    for name, value in settings.items():
        client.log_param(run.info.run_id, name, value)
    opened_by = "" if server else f"mlflow ui --backend-store-uri {shlex.quote(str(folder))}"
    return MlflowLog(client, run.info.run_id, opened_by)


class MlflowLog:
    """`SessionLogger` that writes one run."""

    def __init__(self, client: Any, run: str, opened_by: str) -> None:
        self._client, self._run, self.opened_by = client, run, opened_by

    def values(self, step: int, values: Values) -> None:
        """See `SessionLogger`."""
        for name, value in values.items():
            self._client.log_metric(self._run, _FORBIDDEN.sub("_", name), value, step=step)

    def words(self, step: int, name: str, text: str) -> None:
        """See `SessionLogger`: the newest is a tag of the run, and all are in a file."""
        self._client.set_tag(self._run, name, text)
        self._client.log_text(self._run, text, f"{name}/{step:03d}.txt")

    def picture(self, step: int, name: str, jpeg: bytes) -> None:
        """See `SessionLogger`: it is kept as a file of the run."""
        import tempfile

        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / f"{step:03d}.jpg"
            file.write_bytes(jpeg)
            self._client.log_artifact(self._run, str(file), f"picture/{_FORBIDDEN.sub('_', name)}")

    def close(self) -> None:
        """See `SessionLogger`."""
        self._client.set_terminated(self._run)
