"""Arrays on disk, as safetensors: nothing is ever unpickled."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.numpy import load_file, save_file

from hw.bounded import Unreadable, require_tensors
from sim.errors import CheckpointError
from sim.storage.files import whole_file

Tensors = Mapping[str, NDArray[Any]]


def save_tensors(path: Path, tensors: Tensors) -> None:
    """Write a safetensors file, whole or not at all. Raises OSError."""
    with whole_file(path) as temporary:
        save_file({name: np.asarray(t, order="C") for name, t in tensors.items()}, temporary)


def load_tensors(path: Path) -> dict[str, NDArray[Any]]:
    """The tensors of a file from any source. Raises CheckpointError."""
    try:
        require_tensors(path)
        return dict(load_file(path))
    except Unreadable as error:
        raise CheckpointError(f"{path} {error}: make it again") from error
    except (OSError, SafetensorError) as error:
        raise CheckpointError(f"{path} cannot be read as safetensors ({error}): make it again") from error
