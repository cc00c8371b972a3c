"""Every kind of file of the current folder that decides what moves, is confirmed or runs: a person confirms it once.

The first test walks over all kinds; those below try ways around it.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest
from real_lab import RIG, ToyDevices, Untouched, calibrated, quiet, said, typing, waivers

from adaptsim_cli import config, trust
from adaptsim_cli.bench.devices.known_arm import folder_of
from adaptsim_cli.bench.devices.mounted import mounted_as_shipped
from adaptsim_cli.bench.devices.opening import open_lab
from adaptsim_cli.bench.rig_file.claims import rig_claims
from adaptsim_cli.bench.rig_file.reading import gaps, in_words, rig_of
from adaptsim_cli.commands import app
from adaptsim_cli.config import Resolved
from adaptsim_cli.errors import StoppedByOperator, UsageError
from adaptsim_cli.screen import console
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.session.own.trust import own_claims
from adaptsim_cli.trust import KINDS, PROGRAM, SETTINGS, TASK, FileClaim, Trust
from adaptsim_cli.trust import RIG as RIG_KIND
from hw.workcell import Workcell
from sim.tasks import get_task

PAGE = Path(__file__).parents[2] / "docs" / "guide" / "current-folder.md"
LAMP = '[[keep_out]]\nname = "lamp"\nlow_m = [0.5, -0.9, 0.6]\nhigh_m = [0.7, -0.7, 1.0]\n'
WHOLE = RIG.replace(waivers("keep_out", "stop_button", "slow_start"), "") + LAMP
"""A rig file without gaps, which waives nothing."""


@dataclass(frozen=True)
class Case:
    """A file of the current folder of one kind."""

    file: str
    text: str
    other: str  # another content of the file
    claims: Callable[[], tuple[FileClaim, ...]]


def real_claims() -> tuple[FileClaim, ...]:
    resolved = config.load({"hw": "panda", "task": "scooping"})
    return rig_claims(resolved.config, resolved.places)


def program_claims() -> tuple[FileClaim, ...]:
    Path("adaptsim.toml").write_text('hw = "own"\nanswer_with = "python3 -m robot"\n')
    return own_claims(config.load())


def task_claims() -> tuple[FileClaim, ...]:
    files = [Path("task.py"), Path("scene.toml")]
    return (FileClaim.of_files(TASK, files, "It makes the motions of the task `curl`."),)


CASES: dict[str, Case] = {
    RIG_KIND: Case("rig.toml", WHOLE, WHOLE.replace("0.6]", "0.9]"), real_claims),
    SETTINGS: Case("adaptsim.toml", "pace = 1.0\n", 'hw = "panda"\n', real_claims),
    PROGRAM: Case("robot.py", "print(1)\n", "print(2)\n", program_claims),
    TASK: Case("task.py", "print(1)\n", "print(2)\n", task_claims),
}


def asked(claims: tuple[FileClaim, ...], screen: Screen | None = None, *, asks: bool = True) -> None:
    trust.require(
        claims, Trust(config.places().trust_file), screen or quiet(), asks=asks, command="adaptsim config trust"
    )


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_is_confirmed_once_by_its_path_and_content(kind, place, monkeypatch):
    case = CASES[kind]
    Path(case.file).write_text(case.text)
    Path("scene.toml").write_text("")
    claims = case.claims()
    assert [claim.kind for claim in claims] == [kind]
    with pytest.raises(UsageError, match=r"belongs to the current folder.*at a terminal: adaptsim config trust"):
        asked(claims, asks=False)
    typing(monkeypatch, "", "yes", "", "q")
    with pytest.raises(StoppedByOperator, match="nothing has run or moved"):
        asked(claims)
    with pytest.raises(UsageError):
        asked(claims, asks=False)
    screen = quiet()
    typing(monkeypatch, "", "y")
    asked(claims, screen)
    assert claims[0].meaning in said(screen) and "Do you trust the" in said(screen)
    asked(case.claims(), asks=False)
    assert not list(place.rglob("trusted.json"))

    Path(case.file).write_text(case.other)
    with pytest.raises(UsageError, match=rf"Since you confirmed it, this has changed: \S*{case.file}"):
        asked(case.claims(), asks=False)
    Path(case.file).write_text(case.text)
    asked(case.claims(), asks=False)

    elsewhere = place.parent / "elsewhere"
    place.rename(elsewhere)
    monkeypatch.chdir(elsewhere)
    with pytest.raises(UsageError):
        asked(case.claims(), asks=False)


def test_the_page_lists_every_kind_and_what_it_decides():
    text = PAGE.read_text(encoding="utf-8")
    assert re.findall(r"^\| \*\*(.+?)\*\* \|", text, re.MULTILINE) == list(KINDS)
    for effect in KINDS.values():
        assert f"| {effect} |" in text
    assert f"{trust.MOST_FILES:,} files" in text and f"{trust.MOST_BYTES // 2**20} MB" in text


@pytest.mark.parametrize("kind", KINDS)
def test_a_confirmation_that_came_with_the_folder_never_counts(kind, place, monkeypatch):
    case = CASES[kind]
    Path(case.file).write_text(case.text)
    Path("scene.toml").write_text("")
    home = place.parent / "of-the-attacker"
    for inside in (place, place / "data" / "home"):
        monkeypatch.setenv("ADAPTSIM_HOME", str(home))
        for claim in case.claims():
            Trust(config.places().trust_file).confirm(claim)
        content = (home / "trusted.json").read_bytes()
        inside.mkdir(parents=True, exist_ok=True)
        (inside / "trusted.json").write_bytes(content)
        monkeypatch.setenv("ADAPTSIM_HOME", str(inside))
        monkeypatch.setenv("XDG_CONFIG_HOME", str(place.parent / "xdg"))
        assert config.places().trust_file == place.parent / "xdg/adaptsim/trusted.json"
        with pytest.raises(UsageError):
            asked(case.claims(), asks=False)


def test_a_damaged_store_asks_again_and_one_of_an_older_version_too(place, monkeypatch):
    Path("rig.toml").write_text(WHOLE)
    claims, store = real_claims(), config.places().trust_file
    store.parent.mkdir(exist_ok=True)
    for text in ("", "{", "[]", '["abc"]', '{"confirmed": 3}', '{"confirmed": [3, {}, {"kind": 1}]}'):
        store.write_text(text)
        assert not Trust(store).holds(claims[0])
    Trust(store).confirm(claims[0])
    table = json.loads(store.read_text())
    table["confirmed"][0]["of a newer version"] = 1
    store.write_text(json.dumps(table))
    assert Trust(store).holds(claims[0])


def real_lab() -> Resolved:
    return config.load({"hw": "panda", "task": "scooping"})


def test_a_rig_file_of_the_current_folder_keeps_its_waivers_and_the_labs_memory_to_itself(place, kim):
    """As somebody else's repository has one, with the name of the lab."""
    home = place.parent / "home"
    home.mkdir()
    (home / "rig.toml").write_text(WHOLE)
    own = real_lab()
    everything = waivers("pedal", "person", "keep_out", "payload", "hand", "stop_button", "slow_start")
    bare = 'name = "lab-1"\nconsent = "command"\n[arm]\nmodel = "panda"\naddress = "172.16.0.2"\n'
    Path("rig.toml").write_text(bare + everything)
    foreign = real_lab()
    assert not foreign.config.rig_is_own and own.config.rig_is_own
    assert foreign.sources["rig"] == f"found in {place}"
    rig = rig_of(foreign.config)
    assert rig.in_force() == () and not rig.without_hand
    assert [gap.what for gap in gaps(rig, "scooping")] == ["pedal", "person", "payload", "keep_out"]
    folders = {folder_of(lab.places, rig_of(lab.config)) for lab in (own, foreign)}
    assert len(folders) == 2
    with (
        pytest.raises(UsageError, match=r"names no enabling pedal.*its waivers do not count") as refusal,
        open_lab(foreign.config, get_task("scooping"), Untouched()),  # type: ignore[arg-type]
    ):
        pass
    assert in_words(gaps(rig, "scooping")) in str(refusal.value)


def test_a_real_lab_asks_about_the_folders_files_first_and_names_the_rig_at_the_typed_model(place, kim, monkeypatch):
    Path("rig.toml").write_text(WHOLE + waivers("slow_start", "stop_button"))
    Path("adaptsim.toml").write_text("pace = 0.3\n")
    there, devices, task = real_lab(), ToyDevices(), get_task("scooping")
    calibrated(there)
    typing(monkeypatch, "", "\n", "q")
    with pytest.raises(StoppedByOperator), open_lab(there.config, task, devices.drivers(), quiet()):
        pass
    typing(monkeypatch, "y", "y")
    screen = quiet()
    with open_lab(there.config, task, devices.drivers(), screen):
        pass
    assert devices.opened == {}
    text = said(screen)
    assert "It sets pace = 0.3." in text
    assert "boxes: the person's side (left), lamp" in text
    assert "Its waivers (slow_start, stop_button) do not count" in text
    with open_lab(there.config, task, devices.drivers(), screen) as lab:
        arm = lab._arm(lab_cell(), "scooping", "nothing on the table", "touch-off")  # type: ignore[attr-defined]
    sentence = arm.consent.rig_file
    assert sentence == (
        f"Rig file {place / 'rig.toml'} of the current folder, whose waivers do not count; boxes: the person's side "
        "(left), lamp; waived: none."
    )
    last = quiet()
    arm.consent.screen = last
    arm.consent.known_arm = None
    typing(monkeypatch, "panda")
    arm.consent.once(devices.arm)
    assert said(last).index("Rig file") < said(last).index("Type panda to confirm")


def lab_cell() -> Workcell:
    return mounted_as_shipped(get_task("scooping"), "panda").cell


def test_without_a_terminal_the_refusal_names_the_command_that_confirms(place, monkeypatch):
    Path("rig.toml").write_text(WHOLE)
    there = real_lab()
    with (
        pytest.raises(UsageError, match="Confirm it at a terminal: adaptsim config trust --hw panda"),
        open_lab(there.config, get_task("scooping"), Untouched()),  # type: ignore[arg-type]
    ):
        pass
    asked_at: list[str] = []
    monkeypatch.setattr(console, "require_terminal", asked_at.append)
    typing(monkeypatch, "y")
    assert app.run(["config", "trust", "--hw", "panda"]) == 0
    assert asked_at
    asked(real_claims(), asks=False)


def test_config_trust_asks_nothing_where_nothing_is_to_be_confirmed(place, kim, printed):
    assert app.run(["config", "trust"]) == 0
    assert app.run(["config", "trust", "--hw", "fr3"]) == 0
    assert app.run(["config", "trust", "--hw", "own"]) == 0


def test_a_rig_file_that_the_user_names_is_the_users_own(place, monkeypatch):
    for name in ("here.toml", "there.toml"):
        Path(name).write_text(WHOLE)
    home = place.parent / "home"
    home.mkdir()
    (home / "config.toml").write_text(f'rig = "{place / "there.toml"}"\n')
    assert real_lab().config.rig_is_own
    monkeypatch.setenv("ADAPTSIM_RIG", "here.toml")
    assert real_lab().config.rig == str(place / "here.toml") and real_lab().config.rig_is_own
    monkeypatch.delenv("ADAPTSIM_RIG")
    Path("adaptsim.toml").write_text('rig = "here.toml"\n')
    assert not real_lab().config.rig_is_own
    assert not config.Config(rig=str(home / "rig.toml")).rig_is_own, "settings that nobody loaded own nothing"
