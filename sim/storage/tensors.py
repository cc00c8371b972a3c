"""Tensors on disk: safetensors, so that nothing is ever unpickled."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from safetensors import SafetensorError
from safetensors.torch import load_file, save_file
from torch import Tensor

from hw.bounded import Unreadable, require_tensors
from sim.errors import CheckpointError
from sim.storage.files import whole_file


def save_tensors(path: Path, tensors: Mapping[str, Tensor]) -> None:
    """Write a safetensors file that is there whole or not at all. Raises OSError."""
    with whole_file(path) as temporary:
        save_file({name: t.detach().contiguous() for name, t in tensors.items()}, temporary)


def load_tensors(path: Path) -> dict[str, Tensor]:
    """The tensors of a file that someone else may have written. Raises CheckpointError."""
    try:
        require_tensors(path)
        return dict(load_file(path))
    except Unreadable as error:
        raise CheckpointError(f"{path} {error}: make it again") from error
    except (OSError, SafetensorError) as error:
        raise CheckpointError(f"{path} cannot be read as safetensors ({error}): make it again") from error
