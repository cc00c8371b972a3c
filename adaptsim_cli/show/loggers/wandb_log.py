"""A session for Weights & Biases, offline. `wandb sync` sends it whenever you want; WANDB_MODE=online at once."""

from __future__ import annotations

import io
import os
from pathlib import Path
from typing import Any

from PIL import Image

from adaptsim_cli.show.loggers import Values, Words
from hw.extras import missing
from sim.errors import ExtraMissing

PROJECT = "adaptsim"


def open_logger(folder: Path, session: str, settings: Words) -> WandbLog:
    """See `OpenLogger`."""
    try:
        import wandb
    except ImportError as error:
        raise ExtraMissing(missing("the log for Weights & Biases", "wandb", "wandb")) from error
    is_online = os.environ.get("WANDB_MODE") == "online"
    run = wandb.init(
        project=os.environ.get("WANDB_PROJECT", PROJECT),
        name=session,
        dir=str(folder),
        mode="online" if is_online else "offline",
        config=dict(settings),
        settings=wandb.Settings(silent=True, console="off", disable_git=True, x_disable_stats=True),
    )
    return WandbLog(run, wandb.Image)


class WandbLog:
    """`SessionLogger` that writes one run. The steps of a run must not go back, so the trial is logged as a value."""

    opened_by = ""  # `wandb sync` sends the log to a server, which is for the user to decide

    def __init__(self, run: Any, as_image: Any) -> None:
        self._run, self._as_image = run, as_image
        run.define_metric("*", step_metric="trial")

    def values(self, step: int, values: Values) -> None:
        """See `SessionLogger`."""
        self._run.log({"trial": step, **values})

    def words(self, step: int, name: str, text: str) -> None:
        """See `SessionLogger`: the newest is in the run's summary too."""
        self._run.log({"trial": step, name: text})
        self._run.summary[name] = text

    def picture(self, step: int, name: str, jpeg: bytes) -> None:
        """See `SessionLogger`."""
        image = self._as_image(Image.open(io.BytesIO(jpeg)), caption=f"trial {step}, {name}")
        self._run.log({"trial": step, f"picture/{name}": image})

    def close(self) -> None:
        """See `SessionLogger`."""
        self._run.finish()
