"""A real lab whose command is run in a folder that came from somebody else: its rig file, settings and confirmations.

Judged by what the drivers were asked for and by the files on the disk, not by the program's own words.
"""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import get_args

import numpy as np
from fault_lab import TYPED, Outcome
from real_lab import READY_RAD, ToyDevices, calibrated, waivers
from rich.console import Console

from adaptsim_cli import config
from adaptsim_cli.bench.devices.known_arm import KnownArm, folder_of
from adaptsim_cli.bench.rig_file.claims import rig_claims
from adaptsim_cli.bench.rig_file.reading import read
from adaptsim_cli.bench.rig_file.waivers import Waivable
from adaptsim_cli.errors import CliError
from adaptsim_cli.screen import console
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.session.opening import open_trials
from adaptsim_cli.trust import Trust
from hw.errors import HardwareError
from hw.types import JointPath
from sim.tasks import get_task

HEAD = 'name = "lab"\n{consent}[arm]\nmodel = "panda"\naddress = "172.16.0.2"\n'
PARTS = {
    "pedal": '[pedal]\nport = "/dev/ttyACM0"\n',
    "person": '[person]\nside = "left"\nfrom_m = 0.5\n',
    "payload": "[tools.scooping.payload]\nmass_kg = 0.12\n",
    "keep_out": '[[keep_out]]\nname = "cabinet"\nlow_m = [0.4, -1.4, 0.0]\nhigh_m = [0.9, -1.1, 0.8]\n',
}
OWN = HEAD.format(consent="") + "".join(PARTS.values())
FOLDERS = (
    "folder: rig file",
    "folder: rig file changed",
    "folder: rig file moved",
    "folder: settings",
    "folder: confirmation inside",
    "folder: home inside",
)
MODEL = "full\npanda\ny\n"
"""All that a motion of a lab is asked whose stop button was checked today."""
STILL = JointPath(np.arange(11) / 1e3, np.tile(READY_RAD, (11, 1)))


@dataclass
class Lab:
    """The user's own lab, and a folder of somebody else."""

    root: Path
    home: Path = field(init=False)
    folder: Path = field(init=False)

    def __post_init__(self) -> None:
        self.home, self.folder = self.root / "home", self.root / "cloned"
        for place in (self.home, self.folder):
            place.mkdir(parents=True)
        (self.home / "rig.toml").write_text(OWN)

    @contextmanager
    def inside(self, typed: str, *, home: Path | None = None) -> Iterator[None]:
        """In the folder, at a terminal at which this is typed."""
        kept = {name: os.environ.get(name) for name in ("ADAPTSIM_HOME", "ADAPTSIM_OPERATOR", "XDG_CONFIG_HOME")}
        before, stdin, asks = Path.cwd(), sys.stdin, console.require_terminal
        os.environ["ADAPTSIM_HOME"], os.environ["ADAPTSIM_OPERATOR"] = str(home or self.home), "Kim"
        os.environ["XDG_CONFIG_HOME"] = str(self.root / "xdg")
        os.chdir(self.folder)
        sys.stdin, console.require_terminal = io.StringIO(typed), lambda *_: None
        try:
            yield
        finally:
            sys.stdin, console.require_terminal = stdin, asks
            os.chdir(before)
            for name, value in kept.items():
                os.environ.pop(name, None)
                if value is not None:
                    os.environ[name] = value

    def move(self, typed: str, **where: Path) -> tuple[ToyDevices, str]:
        """One motion of a real arm, as any command of the folder makes it; with what was said."""
        devices, said = ToyDevices(), io.StringIO()
        screen = Screen(console=Console(file=said, width=400, markup=False))
        with self.inside(typed, **where), suppress(CliError, HardwareError):
            there = config.load({"hw": "panda", "task": "scooping"})
            calibrated(there)
            task, drivers = get_task("scooping"), devices.drivers()
            with open_trials(there.config, there.places, task, drivers, screen=screen) as target:
                target.rig.arm.execute(STILL)
        return devices, said.getvalue()


def foreign(rng: np.random.Generator) -> tuple[str, set[str]]:
    """A rig file with the lab's name, and the safeguards that it neither states nor may waive."""
    stated = {name for name in PARTS if rng.random() < 0.85}
    waived = [name for name in get_args(Waivable) if name not in stated and rng.random() < 0.8]
    consent = 'consent = "command"\n' if rng.random() < 0.5 else ""
    text = HEAD.format(consent=consent) + "".join(PARTS[name] for name in PARTS if name in stated) + waivers(*waived)
    return text, set(PARTS) - stated


def one_folder(kind: str, rng: np.random.Generator, root: Path) -> Outcome:
    """A command in a folder with such a file: before a person confirms it, after, and once it is another file."""
    lab, notes, (text, lacking) = Lab(root), list[str](), foreign(rng)
    settings = kind == "folder: settings"
    file = lab.folder / ("adaptsim.toml" if settings else "rig.toml")
    if settings:
        text, lacking = f"pace = {rng.uniform(0.5, 1.0):.2f}\n", set()
    elif rng.random() < 0.3:
        file = lab.folder / "labs" / "arm.toml"
        file.parent.mkdir()
        (lab.folder / "adaptsim.toml").write_text('rig = "labs/arm.toml"\n')
    file.write_text(text)
    asks = int((lab.folder / "adaptsim.toml").exists()) + (not settings)
    with lab.inside(""):
        own = KnownArm(folder_of(config.places(), read(lab.home / "rig.toml")))
        own.stop_button_checked("Kim")
        before = (own.folder / "known.json").read_bytes()
    where: dict[str, Path] = {}
    if kind == "folder: home inside":
        where["home"] = lab.folder / "home"
        where["home"].mkdir()
    if kind in ("folder: confirmation inside", "folder: home inside"):
        with lab.inside("", **where):
            _confirm(where.get("home", lab.folder))

    devices, _ = lab.move(str(rng.choice([*TYPED.values(), "panda\n"])), **where)
    notes += [f"{', '.join(devices.opened)} opened before anybody confirmed"] if devices.opened else []

    devices, said = lab.move(asks * "y\n" + MODEL, **where)
    moved = devices.arm is not None and bool(devices.arm.executed)
    named = str(lab.home / "rig.toml" if settings else file)
    if lacking and devices.opened:
        notes.append(f"devices opened without {', '.join(sorted(lacking))}, which the file waived or left out")
    if moved and not settings:
        notes.append("it moved although nobody checked the stop button of this rig file's arm")
    if moved and f"Rig file {named}" not in said:
        notes.append("the question for the arm's model did not name the rig file")
    if not settings and (own.folder / "known.json").read_bytes() != before:
        notes.append("it wrote into the memory of the lab's own arm")
    used = moved if settings else bool(devices.opened) or bool(lacking)

    if kind == "folder: rig file moved":
        lab.folder = lab.folder.rename(lab.root / "copy")
    elif kind != FOLDERS[0]:
        file.write_text(file.read_text() + "# another content\n")
    devices, _ = lab.move(MODEL.replace("y\n", ""), **where)
    if kind != FOLDERS[0]:
        notes += ["devices opened for another content or place"] if devices.opened else []
    elif bool(devices.opened) == bool(lacking):
        notes.append("a confirmed file was not used, or one with gaps was")
    return Outcome(kind, used, notes, motion="folder")


def _confirm(home: Path) -> None:
    """The confirmations that the folder's author made, for this very place."""
    there = config.load({"hw": "panda"})
    inside = Trust(home / "trusted.json")
    for claim in rig_claims(there.config, there.places):
        inside.confirm(claim)
        assert inside.holds(claim)
