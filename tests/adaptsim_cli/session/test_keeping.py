from __future__ import annotations

import json
import os
import shutil
import zipfile
from dataclasses import asdict
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from toy_rig import OUTCOMES, TASK
from toy_session import NAME, ScriptedOperator, attended, run

from adaptsim_cli.bench.facts import RigFacts, WaiverRecord
from adaptsim_cli.bench.rig_file.waivers import WaiverPart
from adaptsim_cli.commands import app
from adaptsim_cli.errors import SessionError, UsageError
from adaptsim_cli.session import keeping, recording
from adaptsim_cli.session.about import ABOUT
from adaptsim_cli.session.correcting import amend, amendable, redo
from adaptsim_cli.session.flow import run_iteration
from adaptsim_cli.session.folders import OVERLAY, entries, names, own_files, size_bytes
from adaptsim_cli.session.keeping import mark, prune, verify
from adaptsim_cli.session.operator import Review
from adaptsim_cli.session.records import to_json
from adaptsim_cli.session.store import SessionStore
from perception.types import Outcome
from sim.adaptation.stages import TrialKey


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
    shutil.copytree(made, place.parent / "home")
    return place.parent / "home/data/sessions"


def recordings(root: Path) -> list[str]:
    return sorted(str(path.relative_to(root)) for path in root.rglob("*.mcap"))


def test_a_note_leaves_every_seal_whole(root):
    before = verify(root, NAME)
    assert mark(root, NAME, "  before the camera moved ").note == "before the camera moved"
    after = verify(root, NAME)
    assert (after.damage, after.files) == ((), before.files + 1)
    (root / NAME / ABOUT).write_text((root / NAME / ABOUT).read_text().replace("moved", "stood"))
    assert len(verify(root, NAME).damage) == 1


def test_a_session_that_runs_is_not_marked_or_deleted(root):
    with SessionStore.open(root, NAME).locked():
        for act in (partial(keeping.mark, note="a note"), keeping.delete):
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


def test_the_list_has_verdict_size_and_note(root, capfd):
    assert app.run(["sessions", "mark", NAME, "--note", "the first one"]) == 0
    capfd.readouterr()
    assert app.run(["sessions", "list"]) == 0
    shown = capfd.readouterr().out
    for part in (NAME, "the first one", "toy", "4 trials", "Converged"):
        assert part in " ".join(shown.split()).replace("\N{NO-BREAK SPACE}", " ")
    assert app.run(["sessions", "list", "--task", "nothing", "--json"]) == 0
    assert json.loads(capfd.readouterr().out.splitlines()[-1])["sessions"] == []
    assert app.run(["sessions", "list", "--json"]) == 0
    (one,) = json.loads(capfd.readouterr().out.splitlines()[-1])["sessions"]
    assert one["size_bytes"] > 1000
    assert one["verdict"]["kind"] == "converged"


@pytest.mark.parametrize("command", ["delete", "prune"])
def test_what_cannot_be_undone_asks_first(root, command, refused):
    had = recordings(root)
    assert "--yes" in refused(2, "sessions", command, NAME)
    assert recordings(root) == had
    assert app.run(["sessions", command, NAME, "--yes"]) == 0
    assert recordings(root) == []
    assert names(root) == (() if command == "delete" else (NAME,))


@pytest.mark.parametrize("pictures", [False, True])
def test_a_bundle_holds_records_and_pictures_only_if_asked(root, tmp_path, pictures, monkeypatch, capfd):
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
    assert about["packages"]["numpy"].startswith("2.")
    assert about["settings"]["particles"] == {"value": 2, "from": "default"}
    assert not any(str(tmp_path) in text for text in texts)
    assert ("Left out" in capfd.readouterr().out) != pictures


def files_of(root: Path) -> list[Path]:
    """What `verify` reads: all but the report, which is drawn from the rest, the log, which grows, the lock, and the
    picture of the latest search, which the next one replaces.
    """
    files = [path for path in (root / NAME).rglob("*") if path.is_file() and not path.name.startswith(".")]
    left_out = {root / NAME / name for name in ("report.html", "log.jsonl", OVERLAY)}
    return sorted(set(files) - left_out)


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
    mark(store.folder.parent, store.facts.name, "the lamp was moved")
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


def test_a_missing_file_is_noticed(store):
    root = store.folder.parent
    for path in files_of(root):
        content = path.read_bytes()
        path.unlink()
        if not path.name.endswith((".started.json", ".shown.json", "trial.json")):
            assert any(path.name in message for message in verify(root, NAME).damage), path
        path.write_bytes(content)


def test_a_missing_trial_is_noticed_by_the_result_that_rests_on_it(store):
    root = store.folder.parent
    (folder,) = (root / NAME).glob("iteration-01/trial-001-attempt-1")
    shutil.rmtree(folder)
    assert any("a result rests on it" in message for message in verify(root, NAME).damage)


def test_a_file_that_no_record_names_is_noticed(store):
    root = store.folder.parent
    (root / NAME / "iteration-01" / "trial-001-attempt-1" / "other.json").write_text("{}")
    (message,) = verify(root, NAME).damage
    assert "other.json" in message
    assert "it is in no record" in message


def test_a_checksum_that_was_removed_is_noticed(store):
    root = store.folder.parent
    path = root / NAME / "session.toml"
    path.write_bytes(path.read_bytes().rpartition(b"# sha256 ")[0])
    with pytest.raises(SessionError, match="lost its checksum"):
        SessionStore.open(root, NAME)


def small(folder: Path) -> Path:
    (folder / "iteration-01" / "trial-01").mkdir(parents=True)
    (folder / "iteration-01" / "trial-01" / "trial.json").write_text("{}")
    (folder / "log.jsonl").write_bytes(b"\xff\xfe broken\n")
    return folder


def test_links_and_pipes_are_no_part_of_a_session(tmp_path):
    folder, secret = small(tmp_path / "s"), tmp_path / "elsewhere"
    secret.mkdir()
    (secret / "recording.json").write_text("private")
    (folder / "linked").symlink_to(secret, target_is_directory=True)
    (folder / "linked.json").symlink_to(secret / "recording.json")
    os.mkfifo(folder / "pipe.json")
    assert {path.name for path in own_files(folder)} == {"trial.json", "log.jsonl"}
    assert {path.name for path in entries(folder)} == {"iteration-01", "log.jsonl"}
    files, _ = keeping.bundle(folder, tmp_path / "out.zip", {})  # hangs where a pipe is opened
    assert not any("linked" in name or "pipe" in name for name in files)
    assert size_bytes(folder) < 100


def test_an_archive_is_not_replaced_silently(tmp_path):
    folder = small(tmp_path / "s")
    keeping.bundle(folder, tmp_path / "out.zip", {})
    with pytest.raises(UsageError, match="--force"):
        keeping.bundle(folder, tmp_path / "out.zip", {})
    keeping.bundle(folder, tmp_path / "out.zip", {}, force=True)


def test_an_archive_names_no_person(tmp_path):
    folder = small(tmp_path / "s")
    waiver = WaiverPart(safeguard="pedal", reason="the pedal is being repaired", by="Ada Lovelace", on="2026-11-01")
    waivers = (WaiverRecord(**asdict(waiver), until=waiver.until.isoformat()),)
    facts = RigFacts(operator='Jos\u00e9 "Pepe" Ruiz', waivers=waivers)
    (folder / "iteration-01/trial-01/rig.json").write_bytes(to_json(facts))
    lines = ["operator: Kim", "Kim said so, Kimono stays", f"Waived: {waiver.sentence}", "Jos\u00e9 is no name here"]
    (folder / "log.jsonl").write_text("".join(json.dumps({"text": line}) + "\n" for line in lines))
    keeping.bundle(folder, tmp_path / "out.zip", {"operator": "Noether"})
    with zipfile.ZipFile(tmp_path / "out.zip") as archive:
        packed = "".join(archive.read(name).decode() for name in archive.namelist())
    for name in ("Ada", "Lovelace", "Pepe", "Ruiz", "Kim said", "operator: Kim", "Noether"):
        assert name not in packed, name
    assert "Kimono stays" in packed
    assert "is being repaired" in packed


def test_a_stray_folder_changes_nothing_in_a_report_nor_in_the_last_step_of_a_session(root, capfd):
    for name in ("p1 (copy)", "lost+found"):
        (root / name).mkdir()
        (root / name / "session.toml").write_text("not = a session\n")
    assert app.run(["report", NAME]) == 0
    assert (root / NAME / "report.html").exists()
    before = (root / NAME / "report.html").read_bytes()
    store = run(root.parent.parent)  # the last step of an iteration writes the report
    assert store.iterations() == 2
    assert (root / NAME / "report.html").read_bytes() != before
    assert capfd.readouterr().err == ""


def test_a_stray_folder_is_skipped_with_one_note(root, capfd):
    for name in ("p1 (copy)", "lost+found"):
        (root / name).mkdir()
    assert names(root) == (NAME,)
    assert app.run(["sessions", "list"]) == 0
    said = " ".join("".join(capfd.readouterr()).split())  # a long path breaks the line anywhere
    assert "Skipped in" in said
    assert said.count("p1 (copy)") == 1
    assert app.run(["sessions", "verify"]) == 0


def test_a_copied_session_shows_its_folder_and_how_it_was_begun(root, capfd):
    shutil.copytree(root / NAME, root / "copy-of-it")
    assert SessionStore.open(root, "copy-of-it").facts.name == "copy-of-it"
    assert app.run(["sessions", "list", "--json"]) == 0
    rows = {row["session"]: row["begun_as"] for row in json.loads(capfd.readouterr().out)["sessions"]}
    assert rows == {NAME: "", "copy-of-it": NAME}


def test_the_newest_session_is_so_by_its_own_record_however_it_was_copied(root):
    older = root / "older"
    shutil.copytree(root / NAME, older)  # its files are newer
    text = (older / "session.toml").read_text()
    created = SessionStore.open(root, NAME).facts.created
    (older / "session.toml").write_text(text.replace(created, "2020-01-01T00:00:00+00:00"))
    assert names(root) == ("older", NAME)
