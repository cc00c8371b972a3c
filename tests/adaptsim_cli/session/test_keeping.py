from __future__ import annotations

import json
import shutil
import zipfile
from functools import partial
from pathlib import Path

import pytest
from toy_session import NAME, ScriptedOperator, attended, run

from adaptsim_cli import app
from adaptsim_cli.errors import SessionError, UsageError
from adaptsim_cli.session import keeping, recording
from adaptsim_cli.session.flow import run_iteration
from adaptsim_cli.session.keeping import verify
from adaptsim_cli.session.operator import Review
from adaptsim_cli.session.records import TrialKey
from adaptsim_cli.session.store import SessionStore, names


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> Path:
    """A session of one iteration, in which the first trial was redone."""
    home = tmp_path_factory.mktemp("keeping")
    session = attended(home, ScriptedOperator(reviews=[Review(rejected="touched")]))
    run_iteration(session)
    session.store.mark_shown(0, "2024-01-01T00:00:00+00:00")
    return home


@pytest.fixture
def root(made: Path, place) -> Path:
    shutil.copytree(made, place / "home")
    return place / "home/data/sessions"


def recordings(root: Path) -> list[str]:
    return sorted(str(path.relative_to(root)) for path in root.rglob("*.mcap"))


def test_notes_and_tags_leave_every_seal_whole(root):
    before = verify(root, NAME)
    keeping.mark(root, NAME, "  before the camera moved ", ("paper", "olive"))
    said = keeping.mark(root, NAME, add=("paper",), remove=("olive",))
    assert (said.note, said.tags) == ("before the camera moved", ("paper",))
    after = verify(root, NAME)
    assert (after.damage, after.files) == ((), before.files + 1)
    (root / NAME / keeping.ABOUT).write_text((root / NAME / keeping.ABOUT).read_text().replace("paper", "pepper"))
    assert len(verify(root, NAME).damage) == 1


@pytest.mark.parametrize(("add", "remove", "message"), [(("a b",), (), "use letters"), ((), ("x",), "has no tag 'x'")])
def test_a_wrong_tag_is_refused(root, add, remove, message):
    with pytest.raises(UsageError, match=message):
        keeping.mark(root, NAME, add=add, remove=remove, archive=True)
    assert names(root) == (NAME,)


def test_an_archived_session_leaves_the_list_and_comes_back_whole(root):
    keeping.mark(root, NAME, archive=True)
    assert names(root) == ()
    assert names(keeping.archive_of(root)) == (NAME,)
    assert verify(keeping.archive_of(root), NAME).damage == ()
    with pytest.raises(SessionError, match=NAME):
        keeping.mark(root, NAME, archive=True)
    keeping.mark(root, NAME, archive=False)
    assert names(root) == (NAME,)
    assert verify(root, NAME).damage == ()


def test_nothing_takes_the_place_of_another_session(root):
    shutil.copytree(root / NAME, keeping.archive_of(root) / NAME)
    with pytest.raises(UsageError, match="already"):
        keeping.mark(root, NAME, archive=True)
    assert names(root) == (NAME,)


def test_a_session_that_runs_is_not_moved_or_deleted(root):
    with SessionStore.open(root, NAME).locked():
        for act in (partial(keeping.mark, archive=True), keeping.delete):
            with pytest.raises(UsageError, match=NAME):
                act(root, NAME)
    assert names(root) == (NAME,)


def test_pruning_makes_room_and_the_session_stays_whole(root):
    store = SessionStore.open(root, NAME)
    trials, had = store.trials(0), recordings(root)
    room = keeping.prune(store, rejected_only=True)
    assert (room.trials, room.files) == (1, 1)
    assert [path for path in had if path not in recordings(root)] == [
        f"{NAME}/iteration-01/trial-001-attempt-1/recording.mcap"
    ]
    room = keeping.prune(store)
    assert room.trials == 4
    assert recordings(root) == []
    assert verify(root, NAME).damage == ()
    assert store.trials(0) == trials
    assert keeping.prune(store).files == 0
    with pytest.raises(SessionError, match="adaptsim sessions prune"):
        recording.read(store.trial_folder(0, TrialKey(2, 0)) / recording.FILE)
    continued = run(root.parents[1])
    assert (continued.iterations(), len(continued.trials(1))) == (2, 4)


def test_a_recording_that_was_lost_is_still_damage_after_pruning(root):
    store = SessionStore.open(root, NAME)
    keeping.prune(store, rejected_only=True)
    (store.trial_folder(0, TrialKey(2, 0)) / recording.FILE).unlink()
    assert "trial-002-attempt-1/recording.mcap" in verify(root, NAME).damage[0]


def test_the_list_has_verdict_size_note_and_tags(root, capsys):
    assert app.run(["sessions", "mark", NAME, "--note", "the first one", "--tag", "paper"]) == 0
    assert app.run(["sessions", "mark", NAME]) == 2, "it says what can be marked"
    capsys.readouterr()
    assert app.run(["sessions", "list", "--tag", "paper"]) == 0
    said = capsys.readouterr().out
    for part in (NAME, "#paper", "the first one", "toy", "4 trials", "Converged"):
        assert part in " ".join(said.split()).replace("\N{NO-BREAK SPACE}", " ")
    assert app.run(["sessions", "list", "--tag", "nothing", "--json"]) == 0
    assert json.loads(capsys.readouterr().out.splitlines()[-1])["sessions"] == []
    assert app.run(["sessions", "mark", NAME, "--archive"]) == 0
    assert app.run(["sessions", "list", "--archived", "--json"]) == 0
    (one,) = json.loads(capsys.readouterr().out.splitlines()[-1])["sessions"]
    assert one["size_bytes"] > 1000
    assert one["verdict"]["kind"] == "converged"


@pytest.mark.parametrize("command", ["delete", "prune"])
def test_what_cannot_be_undone_asks_first(root, command, capsys):
    had = recordings(root)
    assert app.run(["sessions", command, NAME]) == 2, "nobody is there to be asked"
    assert "--yes" in capsys.readouterr().err
    assert recordings(root) == had
    assert app.run(["sessions", command, NAME, "--yes"]) == 0
    assert recordings(root) == []
    assert names(root) == (() if command == "delete" else (NAME,))


@pytest.mark.parametrize("pictures", [False, True])
def test_a_bundle_holds_records_and_pictures_only_if_asked(root, tmp_path, pictures, monkeypatch, capsys):
    monkeypatch.setattr(Path, "home", lambda: tmp_path)
    out = tmp_path / "b.zip"
    assert app.run(["bundle", NAME, "--out", str(out), *(["--with-pictures"] if pictures else [])]) == 0
    with zipfile.ZipFile(out) as archive:
        names = archive.namelist()
        about = json.loads(archive.read("about.json"))
        texts = [archive.read(name).decode() for name in names if name.endswith((".json", ".toml"))]
    assert f"{NAME}/iteration-01/trial-001-attempt-1/motion.json" in names
    for suffix in (".mcap", ".jpg"):
        assert any(name.endswith(suffix) for name in names) == pictures
    assert about["packages"]["torch"].startswith("2.")
    assert about["settings"]["particles"] == {"value": 2, "from": "default"}
    assert not any(str(tmp_path) in text for text in texts)
    assert ("Left out" in capsys.readouterr().out) != pictures
