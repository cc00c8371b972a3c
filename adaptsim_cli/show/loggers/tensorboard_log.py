"""A session for TensorBoard."""

from __future__ import annotations

import io
import shlex
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from adaptsim_cli.show.loggers import Values, Words
from hw.extras import missing
from sim.errors import ExtraMissing


def open_logger(folder: Path, session: str, settings: Words) -> TensorBoardLog:
    """See `OpenLogger`."""
    try:
        from tensorboardX import SummaryWriter
    except ImportError as error:
        raise ExtraMissing(missing("the log for TensorBoard", "tensorboardX", "tensorboard")) from error
    log = TensorBoardLog(SummaryWriter(str(folder)), f"tensorboard --logdir {shlex.quote(str(folder))}")
    log.words(0, "settings", ", ".join(f"{name} = {value}" for name, value in settings.items()))
    return log


class TensorBoardLog:
    """`SessionLogger` that writes event files."""

    def __init__(self, writer: Any, opened_by: str) -> None:
        self._writer, self.opened_by = writer, opened_by

    def values(self, step: int, values: Values) -> None:
        """See `SessionLogger`."""
        for name, value in values.items():
            self._writer.add_scalar(name, value, step)
        self._writer.flush()

    def words(self, step: int, name: str, text: str) -> None:
        """See `SessionLogger`."""
        self._writer.add_text(name, text, step)

    def picture(self, step: int, name: str, jpeg: bytes) -> None:
        """See `SessionLogger`."""
        pixels = np.asarray(Image.open(io.BytesIO(jpeg)).convert("RGB"))
        self._writer.add_image(f"picture/{name}", pixels, step, dataformats="HWC")

    def close(self) -> None:
        """See `SessionLogger`."""
        self._writer.close()
