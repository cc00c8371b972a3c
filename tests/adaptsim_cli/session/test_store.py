from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from toy_session import NAME, run

from adaptsim_cli.errors import SessionError, UsageError
from adaptsim_cli.session import store as stores
from adaptsim_cli.session.store import SessionStore
from adaptsim_cli.session.summary import details, overview


@pytest.fixture(scope="module")
def complete(tmp_path_factory: pytest.TempPathFactory) -> SessionStore:
    return run(tmp_path_factory.mktemp("complete"))


@pytest.fixture
def store(complete: SessionStore, tmp_path: Path) -> SessionStore:
    """A copy to spoil."""
    root = tmp_path / "data" / "sessions"
    shutil.copytree(complete.folder, root / complete.facts.name)
    return SessionStore.open(root, complete.facts.name)


def reopened(store: SessionStore) -> SessionStore:
    return SessionStore.open(store.folder.parent, store.facts.name)


@pytest.mark.parametrize(
    "file",
    [
        "session.toml",
        "start.json",
        "iteration-00/trial-002-attempt-0/trial.json",
        "iteration-00/trial-002-attempt-0/recording.mcap",
        "iteration-00/result-0/result.json",
        "iteration-00/result-0/summary.json",
    ],
)
@pytest.mark.parametrize("cut", [0.0, 0.6])
def test_a_truncated_file_is_named(store: SessionStore, file: str, cut: float) -> None:
    path = store.folder / file
    content = path.read_bytes()
    path.write_bytes(content[: int(len(content) * cut)])
    with pytest.raises(SessionError, match=r"is corrupt or incomplete") as caught:
        details(reopened(store))
        reopened(store).summary(0)
    assert str(path) in str(caught.value)


def test_a_missing_recording_is_named(store: SessionStore) -> None:
    (store.folder / "iteration-00/trial-001-attempt-0/recording.mcap").unlink()
    with pytest.raises(SessionError, match=r"trial-001-attempt-0/recording.mcap .*it is missing"):
        overview(reopened(store))


def test_a_foreign_file_among_the_trials_is_named(store: SessionStore) -> None:
    (store.folder / "iteration-00/trial-one").mkdir()
    with pytest.raises(SessionError, match="trial-one is corrupt"):
        store.existing()


def test_a_value_of_another_kind_is_named(store: SessionStore) -> None:
    path = store.folder / "session.toml"
    path.write_text(path.read_text().replace("seed = 0", 'seed = "zero"'))
    with pytest.raises(SessionError, match=r"session.toml is corrupt.*seed: "):
        reopened(store)


def test_a_newer_format_asks_for_a_newer_version(store: SessionStore) -> None:
    path = store.folder / "session.toml"
    path.write_text(path.read_text().replace("format = 1", "format = 2"))
    with pytest.raises(SessionError, match="Install a newer adaptsim"):
        reopened(store)


def test_what_a_killed_process_left_behind_is_not_read(store: SessionStore) -> None:
    before = store.existing()
    (store.folder / "iteration-00" / ".trial-005-attempt-0.writing").mkdir()
    (store.folder / "iteration-00" / ".result-1.writing").mkdir()
    assert store.existing() == before


def test_a_session_runs_in_one_process_at_a_time(store: SessionStore) -> None:
    with store.locked(), pytest.raises(UsageError, match="is being run by another process"), reopened(store).locked():
        pass
    with store.locked():
        pass


@pytest.mark.parametrize("name", ["", "../elsewhere", "a/b", ".hidden", "x" * 101])
def test_a_session_cannot_be_named_like_a_path(tmp_path: Path, name: str) -> None:
    with pytest.raises(UsageError, match="session name"):
        SessionStore.open(tmp_path, name)


def test_a_missing_session_lists_those_there_are(store: SessionStore) -> None:
    with pytest.raises(SessionError, match=f"no session 'nope' .*{NAME}"):
        SessionStore.open(store.folder.parent, "nope")


def test_the_newest_session_is_the_one_begun_last(tmp_path: Path) -> None:
    with pytest.raises(SessionError, match="no sessions"):
        stores.newest(tmp_path / "data" / "sessions")
    run(tmp_path, seed=2)
    run(tmp_path, seed=1)
    assert stores.newest(tmp_path / "data" / "sessions") == "toy-wd-adaptsim-seed1"
