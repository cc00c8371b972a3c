"""The log of a session: every question, answer, step, plan and warning, one JSON object a line."""

from __future__ import annotations

import io
from pathlib import Path

import pytest
from toy_rig import ToyLab, opener
from toy_session import NAME, resolved, run, silent

from adaptsim_cli.screen import log
from adaptsim_cli.screen.clean_console import CleanConsole
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.session import running, watching
from adaptsim_cli.session.store import SessionStore
from adaptsim_cli.show import page
from hw.errors import CameraError


def test_a_session_tells_what_happened_in_order(store):
    lines = log.read(store.folder)
    assert lines[0].event == "begun"
    assert [line.event for line in lines][-3:] == ["reported", "done", "ended"]
    plans = [line.data for line in lines if line.event == "planned"]
    assert [(plan["iteration"], plan["particle"], plan["trial"], plan["attempt"]) for plan in plans] == [
        (1, 1, 1, 1),
        (1, 1, 2, 1),
        (1, 2, 3, 1),
        (1, 2, 4, 1),
    ]
    assert [plan["action"] for plan in plans] == [trial.action for trial in store.trials(0)]
    told = [line.data["reward"] for line in lines if line.event == "tracked"]
    assert told == [trial.reward for trial in store.trials(0)]
    steps = {line.data["stage"]: line.took_s for line in lines if line.event == "done"}
    assert {"placing", "planning", "moving", "tracking", "adapting"} <= set(steps)
    assert all(took is not None and took >= 0.0 for took in steps.values())


def test_what_stops_a_command_is_its_last_line(tmp_path):
    def lost(trial: int, attempt: int) -> None:
        raise CameraError("the camera is gone")

    with pytest.raises(CameraError):
        run(tmp_path, ToyLab(0, {"stop_recording": lost}))
    folder = resolved(tmp_path).places.sessions / NAME
    last = log.read(folder)[-1]
    assert (last.event, last.text, last.data) == ("ended", "the camera is gone", {"error": "CameraError"})
    assert any(line.event == "noted" and "does not count" in line.text for line in log.read(folder))


def test_a_line_that_was_cut_short_is_left_out_and_the_next_begins_anew(store):
    file = store.folder / log.FILE
    whole = log.read(store.folder)
    file.write_bytes(file.read_bytes()[:-9])
    watching.SessionLog(store.folder, silent()).write("noted", "after the power came back")
    assert [line.text for line in log.read(store.folder)][-1] == "after the power came back"
    assert len(log.read(store.folder)) == len(whole), "one line lost, one line more"


def test_a_log_that_cannot_be_written_stops_no_session(tmp_path, monkeypatch):
    def full(path: Path, text: str) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(log, "_append", full)
    settings = resolved(tmp_path)
    request = running.SessionRequest(None, frozenset({"task"}), 1, yes=True)
    running.run_session(settings, request, opener(ToyLab(0)), page.write)
    store = SessionStore.open(settings.places.sessions, NAME)
    assert not (store.folder / log.FILE).exists()
    assert store.result(0) is not None


def test_a_log_goes_on_when_the_disk_does_and_the_screen_tells_each_gap_once(tmp_path, monkeypatch):
    def full(path: Path, text: str) -> None:
        with path.open("a") as file:
            file.write(text[:5])
        raise OSError(28, "No space left on device")

    screen, notes, append = silent(), list[str](), log._append
    monkeypatch.setattr(screen, "note", notes.append)
    written = watching.SessionLog(tmp_path, screen)
    for disk, texts in ((append, "a"), (full, "bc"), (append, "de"), (full, "f"), (append, "g")):
        monkeypatch.setattr(log, "_append", disk)
        for text in texts:
            written.write("noted", text)
    assert [line.text for line in log.read(tmp_path)] == ["a", "d", "e", "g"]
    assert len(notes) == 2
    assert all("the disk is full" in note for note in notes)


def written(folder: Path, count: int = 4) -> Path:
    folder.mkdir()
    written = watching.SessionLog(folder, Screen(console=CleanConsole(file=io.StringIO())))
    for number in range(count):
        written.noted(f"line {number}")
    return folder / log.FILE


def test_a_log_goes_on_also_behind_a_line_that_a_power_cut_truncated(tmp_path):
    path = written(tmp_path / "s")
    path.write_text(path.read_text() + '{"at": "2026')
    watching.SessionLog(path.parent, Screen(console=CleanConsole(file=io.StringIO()))).noted("later")
    assert [line.text for line in log.read(path.parent)] == [*(f"line {n}" for n in range(4)), "later"]


def test_a_log_of_another_version_is_read_without_its_additions(tmp_path):
    path = written(tmp_path / "s", 1)
    path.write_text('{"at": "2026-11-01T10:00:00.000+00:00", "event": "noted", "text": "old", "seal": "0f"}\n')
    assert [line.text for line in log.read(path.parent)] == ["old"]
