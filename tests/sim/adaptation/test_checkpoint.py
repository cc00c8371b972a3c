import dataclasses
import shutil
import tomllib
from pathlib import Path

import numpy as np
import pytest
import tomli_w
from toy_learning import trained
from toy_task import TOY

from sim.adaptation.card import CARD, list_checkpoints, read_card
from sim.adaptation.checkpoint import MODEL, load_checkpoint, save_checkpoint
from sim.adaptation.methods import make_method
from sim.errors import CheckpointError
from sim.research.methods.q_network import QNetwork
from sim.research.methods.q_policy import MemoryName, QPolicy, networks_of, new_policy, tensors_of
from sim.storage.files import load_tensors, read_toml, save_tensors, sha256, write_toml
from sim.tasks import files_of, get_task
from sim.tasks.own_object import task_of_object
from sim.types import Dimension, Space


@pytest.fixture
def stored(tmp_path):
    emulator, _ = trained()
    networks: dict[MemoryName, QNetwork] = {
        "iteration": new_policy(TOY, "iteration", 5),
        "history": new_policy(TOY, "history", 6),
    }
    return save_checkpoint(TOY, tmp_path / "mine", emulator, tensors_of(networks), {"seed": 7})


def chosen(name, checkpoint):
    method = make_method(name, TOY, checkpoint)
    assert isinstance(method, QPolicy)
    return method


def test_targets_beyond_the_ranges_change_only_the_papers_policies():
    default, wide = (load_tensors(files_of("pushing", "checkpoints") / name / MODEL) for name in ("default", "wide"))
    same = {name for name, tensor in default.items() if name in wide and np.array_equal(tensor, wide[name])}
    parts = ("emulator.", "prospects.")
    assert {name for name in default if name.startswith(parts)} == {name for name in same if name.startswith(parts)}
    assert len([name for name in same if name.startswith(parts)]) > 10
    assert not all(name in same for name in default if name.startswith("q_network."))


def test_it_comes_back_as_it_was(stored):
    checkpoint = load_checkpoint(TOY, str(stored))
    emulator, _ = trained()
    rng = np.random.default_rng(0)
    draws = tuple(space.sample(rng, 5) for space in (TOY.margin, TOY.context, TOY.action, TOY.nuisance))
    assert checkpoint.emulator is checkpoint.solver is not None
    assert np.array_equal(checkpoint.emulator.predict(*draws).success, emulator.predict(*draws).success)
    original = new_policy(TOY, "iteration", 5)
    states = rng.random((8, original.inputs))
    assert np.array_equal(networks_of(checkpoint)["iteration"].directions(states), original.directions(states))
    assert chosen("adaptsim-history", checkpoint).memory == "history"
    assert chosen("adaptsim-iteration", checkpoint).memory == "iteration"
    assert checkpoint.card.seed == 7
    assert checkpoint.card.interface["parameters"][0]["name"] == "mu"
    assert {"torch", "drake", "numpy"} <= checkpoint.card.versions.keys()
    assert sorted(p.name for p in stored.iterdir()) == [CARD, MODEL]


def test_changed_weights_are_found(stored):
    model = stored / MODEL
    content = bytearray(model.read_bytes())
    content[-3] ^= 1
    model.write_bytes(content)
    with pytest.raises(CheckpointError, match="damaged or was changed"):
        load_checkpoint(TOY, str(stored))


def test_another_task_or_range_is_refused_by_name(stored):
    with pytest.raises(CheckpointError, match="is for toy, not for other"):
        load_checkpoint(dataclasses.replace(TOY, name="other"), str(stored))
    wider = Space((*TOY.parameters.dimensions[:3], Dimension("h", "cm", 1.0, 3.0)))
    with pytest.raises(CheckpointError, match="trained with different parameters of toy"):
        load_checkpoint(dataclasses.replace(TOY, parameters=wider), str(stored))


@pytest.mark.parametrize(
    ("card", "message"),
    [
        ("format = ", "not valid TOML"),
        ("format = 1", "has no fingerprint"),
        (None, r"for toy \(none is shipped\): make one"),
    ],
)
def test_a_broken_card_says_what_to_do(stored, card, message):
    if card is None:
        (stored / CARD).unlink()
    else:
        (stored / CARD).write_text(card)
    with pytest.raises(CheckpointError, match=message):
        load_checkpoint(TOY, str(stored))


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("sha256 = 5", r"wrong sha256 \(Input should be a valid string\)"),
        ('interface = "all"', "wrong interface"),
        ('simulations = "many"', "wrong simulations"),
        ("[emulator]\naccuracy = 0.9", r"has no .*emulator\.brier"),
        ("[budget]\nrollouts = []", r"wrong budget\.rollouts"),
    ],
)
def test_a_card_with_a_wrong_value_names_it(stored, line, message):
    known = tomllib.loads((stored / CARD).read_text())
    (stored / CARD).write_text(tomli_w.dumps(known | tomllib.loads(line)))
    with pytest.raises(CheckpointError, match=message):
        load_checkpoint(TOY, str(stored))


@pytest.mark.parametrize(("task", "name", "folder"), list_checkpoints())
def test_shipped_checkpoints_load_and_their_cards_are_written_again_as_they_were(task, name, folder):
    """One that was made for an object has the object's file beside it."""
    made_for = task_of_object(task, name if (folder / "object.toml").exists() else "")
    assert load_checkpoint(made_for, name).path == folder
    written = tomllib.loads(tomli_w.dumps(read_card(folder, task).facts()))
    assert written == tomllib.loads((folder / CARD).read_text())


def test_another_format_and_missing_weights_are_refused(stored):
    (stored / MODEL).unlink()
    with pytest.raises(CheckpointError, match=r"model\.safetensors is missing"):
        load_checkpoint(TOY, str(stored))
    text = (stored / CARD).read_text().replace("format = 1", "format = 9")
    (stored / CARD).write_text(text)
    with pytest.raises(CheckpointError, match="format 9"):
        load_checkpoint(TOY, str(stored))


@pytest.fixture
def copied(tmp_path):
    return Path(shutil.copytree(files_of("pushing", "checkpoints") / "default", tmp_path / "mine"))


def changed(folder, name, values):
    tensors = load_tensors(folder / MODEL) | {name: values}
    save_tensors(folder / MODEL, tensors)
    write_toml(folder / CARD, read_toml(folder / CARD) | {"sha256": sha256(folder / MODEL)})


@pytest.mark.parametrize(
    ("factor", "said"), [(np.nan, "not finite"), (np.inf, "not finite"), (1e38, "at most"), (1.5, "in its card")]
)
def test_weights_that_were_changed_with_their_hash(copied, factor, said):
    last = load_tensors(copied / MODEL)["emulator.w0"]
    with np.errstate(all="ignore"):
        changed(copied, "emulator.w0", (last * np.float32(factor)).astype(np.float32))
    with pytest.raises(CheckpointError, match=said):
        load_checkpoint(get_task("pushing"), str(copied))


def test_weights_of_another_shape(copied):
    changed(copied, "emulator.b0", np.zeros((1, 1, 3), dtype=np.float32))
    with pytest.raises(CheckpointError, match="fit one another"):
        load_checkpoint(get_task("pushing"), str(copied))


def test_a_card_without_a_self_test_is_refused(copied):
    card = read_toml(copied / CARD)
    del card["self_test"]
    write_toml(copied / CARD, card)
    with pytest.raises(CheckpointError, match="has no self_test"):
        load_checkpoint(get_task("pushing"), str(copied))
