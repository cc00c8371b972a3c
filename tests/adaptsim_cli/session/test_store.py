from __future__ import annotations

import fcntl
import json
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Barrier

import pytest
from toy_rig import ToyLab, toy_parts
from toy_session import NAME, resolved

from adaptsim_cli.errors import SessionError, UsageError
from adaptsim_cli.session import beginning, folders, keeping, records
from adaptsim_cli.session.history import results_of, trials_of
from adaptsim_cli.session.store import SessionStore
from adaptsim_cli.session.summary import details
from adaptsim_cli.storage.durable import seal_json, seal_toml
from hw.records import AnyRecord
from perception.types import Outcome


def reopened(store: SessionStore) -> SessionStore:
    return SessionStore.open(store.folder.parent, store.facts.name)


@pytest.mark.parametrize(
    "file",
    [
        "session.toml",
        "start.json",
        "iteration-01/trial-002-attempt-1/trial.json",
        "iteration-01/trial-002-attempt-1/recording.mcap",
        "iteration-01/result-1/result.json",
    ],
)
@pytest.mark.parametrize("cut", [0.0, 0.6])
def test_a_truncated_file_is_named(store, file, cut):
    path = store.folder / file
    content = path.read_bytes()
    path.write_bytes(content[: int(len(content) * cut)])
    with pytest.raises(SessionError, match="corrupt") as caught:
        details(reopened(store))
    assert str(path) in str(caught.value)


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        (b"seed = 0", b'seed = "zero"', r"session\.toml .*seed: "),
        (b"format = 4", b"format = 9", r"of format 9, .* reads format 5\. .*--session"),
    ],
)
def test_a_value_of_another_kind_and_another_format_are_named(store, old, new, told):
    path = store.folder / "session.toml"
    body, _, _ = path.read_bytes().rpartition(b"# sha256 ")
    path.write_bytes(seal_toml(body.replace(old, new)))
    with pytest.raises(SessionError, match=told):
        reopened(store)


def test_a_newer_version_may_add_fields_to_every_record_and_this_one_keeps_and_names_them(store):
    before = details(reopened(store))
    add_to(store.folder / "session.toml", b"context_off = 0.5\n")
    for file in ("start.json", "iteration-01/trial-002-attempt-1/trial.json", "iteration-01/result-1/result.json"):
        add_to(store.folder / file, b',\n "settled": {"after_s": 0.25}')
    shown = details(opened := reopened(store))
    assert shown.newer_keys == ("context_off", "settled")
    assert shown.model_copy(update={"newer_keys": (), "facts": before.facts}) == before
    assert keeping.verify(store.folder.parent, store.facts.name).damage == ()
    assert keeping.verify(store.folder.parent, store.facts.name).newer_keys == ("context_off", "settled")
    trial = trials_of(opened)[1].counting_as(Outcome.ON_TABLE, 0.0, (0.0, 0.0))
    assert json.loads(records.to_json(trial))["settled"] == {"after_s": 0.25}


def add_to(path: Path, addition: bytes) -> None:
    """Write a field of a newer version into a sealed record."""
    is_toml = path.suffix == ".toml"
    body, _, _ = path.read_bytes().rpartition(b"# sha256 " if is_toml else b',\n "sealed": ')
    path.write_bytes(seal_toml(addition + body) if is_toml else seal_json(body + addition + b"\n}\n"))


def test_what_a_killed_process_left_behind_is_not_read_and_goes_with_the_next_command(store):
    before, left = store.existing(), store.folder / "iteration-01" / ".trial-005-attempt-1.x1.writing"
    left.mkdir()
    (left / "recording.mcap").write_bytes(b"half")
    assert store.existing() == before
    with store.locked():
        assert not left.exists()
    assert reopened(store).existing() == before


def test_a_session_runs_in_one_process_at_a_time(store):
    with store.locked(), pytest.raises(UsageError, match="another process"), reopened(store).locked():
        pass
    with store.locked():
        pass


def test_a_session_that_is_moved_while_a_command_waits_for_it_is_not_taken(store, monkeypatch):
    """Its lock goes along with it: whoever holds the lock then would write where no session is any more."""
    lock, root = fcntl.flock, store.folder.parent

    def late(descriptor: int, operation: int) -> None:
        if operation & fcntl.LOCK_NB and store.folder.is_dir():
            store.folder.rename(root / "elsewhere")
        lock(descriptor, operation)

    monkeypatch.setattr(fcntl, "flock", late)
    with pytest.raises(SessionError, match="another process"), store.locked():
        pass
    with pytest.raises(SessionError, match="not there"), store.locked():
        pass
    assert not store.folder.exists()


def test_of_two_that_begin_a_session_at_once_one_wins(undisturbed, tmp_path):
    for race in range(10):
        root, gate = tmp_path / str(race), Barrier(2)

        def begin(seed: int, root: Path = root, gate: Barrier = gate) -> SessionStore | None:
            gate.wait()
            try:
                return SessionStore.create(root, undisturbed.facts.model_copy(update={"seed": seed}), undisturbed.start)
            except SessionError:
                return None

        with ThreadPoolExecutor(2) as pool:
            (winner,) = [made for made in pool.map(begin, (1, 2)) if made is not None]
        assert SessionStore.open(root, undisturbed.facts.name).facts == winner.facts
        assert {entry.name for entry in root.iterdir()} == {undisturbed.facts.name, ".lock"}


@pytest.mark.parametrize("name", ["", "../elsewhere", "a/b", ".hidden", "x" * 101])
def test_a_session_cannot_be_named_like_a_path(tmp_path, name):
    with pytest.raises(UsageError, match="session name"):
        SessionStore.open(tmp_path, name)


def test_a_missing_session_lists_those_there_are(store):
    with pytest.raises(SessionError, match=f"no session 'nope' .*{NAME}"):
        SessionStore.open(store.folder.parent, "nope")


def test_a_disk_that_does_not_tell_capital_letters_apart_gives_a_session_one_name(store):
    root, other = store.folder.parent, store.facts.name.upper()
    (root / other).symlink_to(store.folder)  # it is there under that name, and not listed
    with pytest.raises(
        SessionError, match=f"no session '{other}' .* does not tell that name from '{store.facts.name}'"
    ):
        SessionStore.open(root, other)


def test_the_newest_session_is_the_one_begun_last(tmp_path):
    with pytest.raises(SessionError, match="no sessions"):
        folders.newest(tmp_path / "data" / "sessions")
    for seed in (2, 1):
        settings = resolved(tmp_path, seed=seed)
        beginning.begin(settings.places.sessions, f"toy-wd-seed{seed}", settings.config, toy_parts(ToyLab(0)))
    assert folders.newest(tmp_path / "data" / "sessions") == "toy-wd-seed1"


def test_a_record_is_read_once_however_often_a_session_asks_for_it(store, monkeypatch):
    opened, read = list[Path](), records.read

    def counted(kind: type[AnyRecord], path: Path) -> AnyRecord:
        opened.append(path)
        return read(kind, path)

    monkeypatch.setattr(records, "read", counted)
    for _ in range(3):
        found = (*trials_of(store), *results_of(store))
    assert len(opened) == len(set(opened)) == len(found) == 5


def test_the_trials_of_an_iteration_are_found_without_looking_at_other_iterations(store):
    (store.folder / "iteration-02").mkdir(exist_ok=True)
    (store.folder / "iteration-02/foreign.txt").write_text("no record")
    assert [trial.trial for trial in store.trials(0)] == [1, 2, 3, 4]
    with pytest.raises(SessionError, match="foreign"):
        store.existing()


def test_a_foreign_file_among_the_trials_is_named(store: SessionStore) -> None:
    (store.folder / "iteration-01/trial-one").mkdir()
    with pytest.raises(SessionError, match="trial-one"):
        store.existing()
