"""A changed bit in any file of a session is noticed, and the damage of one session hides no other."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from toy_rig import OUTCOMES, TASK
from toy_session import NAME, run

from adaptsim_cli.errors import SessionError
from adaptsim_cli.session.correcting import amend, amendable, redo
from adaptsim_cli.session.keeping import mark, prune, verify
from adaptsim_cli.session.store import SessionStore
from perception.types import Outcome


@pytest.fixture
def root(store: SessionStore) -> Path:
    return store.folder.parent


def files_of(root: Path) -> list[Path]:
    """What `verify` reads: all but the report, which is drawn from the rest, the log, which grows, and the lock."""
    files = [path for path in (root / NAME).rglob("*") if path.is_file() and not path.name.startswith(".")]
    return sorted(path for path in files if path.name not in ("report.html", "log.jsonl", "log.end"))


@pytest.fixture(scope="module")
def corrected(tmp_path_factory) -> SessionStore:
    """Every kind of file: a trial was redone and its rejected recording pruned, an outcome amended, a note written."""
    home = tmp_path_factory.mktemp("corrected")
    redo(run(home), 2, "it was pushed by hand")
    store = run(home)
    _, choices = amendable(store, TASK, OUTCOMES, 3)
    amend(store, TASK, 3, Outcome.LOST, choices[Outcome.LOST], "seen on the recording")
    store = run(home)
    assert prune(store, rejected_only=True).files > 0
    mark(store.folder.parent, store.facts.name, "the lamp was moved", ("paper",))
    return store


@pytest.mark.long
@pytest.mark.parametrize("each", [1, pytest.param(12, marks=pytest.mark.slow)])
def test_a_changed_bit_in_any_file_is_noticed(corrected, tmp_path, each):
    rng, root = np.random.default_rng(each), tmp_path
    shutil.copytree(corrected.folder, root / NAME)
    files = files_of(root)
    for kind in ("rejected", "amended", "shown", "started", "about", "pruned", "result-3", ".mcap"):
        assert any(kind in str(path.relative_to(root)) for path in files), kind
    assert not verify(root, NAME).damage
    flips = [
        (path, int(rng.integers(path.stat().st_size)), int(rng.integers(8))) for path in files for _ in range(each)
    ]
    unnoticed = []
    for path, place, bit in flips:
        content = path.read_bytes()
        path.write_bytes(content[:place] + bytes([content[place] ^ (1 << bit)]) + content[place + 1 :])
        if not any(str(path) in message for message in verify(root, NAME).damage):
            unnoticed.append((path, place, bit))
        path.write_bytes(content)
    assert len(flips) >= 25 * each
    assert not unnoticed


def test_a_missing_file_is_noticed(root):
    for path in files_of(root):
        content = path.read_bytes()
        path.unlink()
        if not path.name.endswith((".started.json", ".shown.json", "trial.json")):
            assert any(path.name in message for message in verify(root, NAME).damage), path
        path.write_bytes(content)


def test_a_missing_trial_is_noticed_by_the_result_that_rests_on_it(root):
    (folder,) = (root / NAME).glob("iteration-01/trial-001-attempt-1")
    shutil.rmtree(folder)
    assert any("a result rests on it" in message for message in verify(root, NAME).damage)


def test_a_file_that_no_record_names_is_noticed(root):
    (root / NAME / "iteration-01" / "trial-001-attempt-1" / "other.json").write_text("{}")
    (message,) = verify(root, NAME).damage
    assert "other.json" in message
    assert "it is in no record" in message


def test_a_checksum_that_was_removed_is_noticed(root):
    path = root / NAME / "session.toml"
    path.write_bytes(path.read_bytes().rpartition(b"# sha256 ")[0])
    with pytest.raises(SessionError, match="lost its checksum"):
        SessionStore.open(root, NAME)
