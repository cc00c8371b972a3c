"""A checkpoint that is not the one that was trained is refused before it predicts anything."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from hw.types import Array
from sim.adaptation import checkpoint
from sim.adaptation.checkpoint import CARD
from sim.errors import CheckpointError
from sim.storage.files import load_tensors, read_toml, save_tensors, sha256, write_toml
from sim.tasks import files_of, get_task


@pytest.fixture
def copied(tmp_path: Path) -> Path:
    return Path(shutil.copytree(files_of("pushing", "checkpoints") / "default", tmp_path / "mine"))


def changed(folder: Path, name: str, values: Array) -> None:
    tensors = load_tensors(folder / checkpoint.MODEL) | {name: values}
    save_tensors(folder / checkpoint.MODEL, tensors)
    write_toml(folder / CARD, read_toml(folder / CARD) | {"sha256": sha256(folder / checkpoint.MODEL)})


@pytest.mark.parametrize(
    ("factor", "said"), [(np.nan, "not finite"), (np.inf, "not finite"), (1e38, "at most"), (1.5, "in its card")]
)
def test_weights_that_were_changed_with_their_hash(copied: Path, factor: float, said: str) -> None:
    last = load_tensors(copied / checkpoint.MODEL)["emulator.w0"]
    with np.errstate(all="ignore"):
        changed(copied, "emulator.w0", (last * np.float32(factor)).astype(np.float32))
    with pytest.raises(CheckpointError, match=said):
        checkpoint.load_checkpoint(get_task("pushing"), str(copied))


def test_weights_of_another_shape(copied: Path) -> None:
    changed(copied, "emulator.b0", np.zeros((1, 1, 3), dtype=np.float32))
    with pytest.raises(CheckpointError, match="fit one another"):
        checkpoint.load_checkpoint(get_task("pushing"), str(copied))


def test_a_card_without_a_self_test_gets_one_without_training(copied: Path) -> None:
    card = read_toml(copied / CARD)
    stored = card.pop("self_test")
    write_toml(copied / CARD, card)
    with pytest.raises(CheckpointError, match="has no self_test"):
        checkpoint.load_checkpoint(get_task("pushing"), str(copied))
    assert checkpoint.add_self_test(copied)
    assert read_toml(copied / CARD)["self_test"] == pytest.approx(stored, abs=1e-6)  # processors round differently
    checkpoint.load_checkpoint(get_task("pushing"), str(copied))
