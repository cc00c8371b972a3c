"""Damaged and hostile files for every reader of files that people or devices write: one error each, never a traceback.

    PYTHONPATH=tests/support python benchmarks/fuzz.py [--minutes 20] [--seed 0] [--reader NAME]

Each case takes a valid file and changes it: bytes flipped, cut, doubled or replaced by awkward tokens; in TOML and JSON
also values replaced and keys removed or renamed. A reader may accept the file or raise an error of this program.
Anything else is printed with its reader and number, and `--only NUMBER --reader NAME` repeats it.
"""

from __future__ import annotations

import argparse
import copy
import io
import json
import sys
import tempfile
import time
import tomllib
import traceback
import warnings
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import tomli_w

sys.path.append(str(Path(__file__).parents[1] / "tests" / "support"))
import real_views

from adaptsim_cli import config
from adaptsim_cli.calibration import printing
from adaptsim_cli.calibration.solving import solve_folder
from adaptsim_cli.devices.rig_file import reading
from adaptsim_cli.errors import CliError
from adaptsim_cli.screen.console import CleanConsole, Screen
from adaptsim_cli.session import watching
from adaptsim_cli.session.store import SessionStore
from calib import files
from calib.errors import CalibrationError
from calib.records import SetupRecord, TouchRecord, read
from calib.saved import SavedCalibration
from hw.bounded import Unreadable, read_table
from hw.errors import HardwareError
from perception.errors import PerceptionError
from sim.adaptation.checkpoint import CARD, read_card
from sim.errors import SimError
from sim.lab.world import load_world
from sim.storage.files import load_tensors
from sim.tasks import files_of, get_task
from sim.tasks.own_object import load_object

OURS = (CliError, CalibrationError, SimError, HardwareError, PerceptionError, Unreadable)
VALUES: tuple[Any, ...] = (
    None, True, -1, 0, 1e308, -1e308, 1e-320, 2**63, 10**40, float("inf"), float("nan"), "", "x", "../../etc",
    "\x1b[2J", "\x00", "é" * 50, [], [[]], {}, {"a": {}}, [1, "a"], [[1.0, 2.0], [3.0]], "1979-05-27",
    [float("nan")] * 4,
)  # fmt: skip
TOKENS = (
    b"nan",
    b"inf",
    b"-",
    b"1e999",
    b"[[",
    b"]",
    b"{",
    b'"',
    b"\x00",
    b"\xff\xfe",
    b"9" * 400,
    b"\\u0000",
    b"\n",
    b"=",
)


@dataclass(frozen=True)
class Reader:
    """One kind of file."""

    name: str
    valid: bytes
    file: str  # its name
    load: Callable[[Path], object]  # reads the file at this path


def readers() -> list[Reader]:
    """All readers, each with a valid file."""
    with tempfile.TemporaryDirectory() as made:
        folder = real_views.corner_folder(Path(made))
        setup, view = (folder / files.SETUP).read_bytes(), (folder / "view-00.json").read_bytes()
        solved = solve_folder(folder, hw="recorded", created="2026-01-01", versions={})
        calibration = solved.record.content()
        log = watching.SessionLog(folder, _silent())
        for number in range(3):
            log.noted(f"line {number}")
        lines = (folder / watching.FILE).read_bytes()
    png = cv2.imencode(".png", np.arange(3072).astype(np.uint8).reshape(32, 32, 3))[1].tobytes()
    touch = json.dumps({"image": "touch.png", "corner": 0, "X_BF": [np.eye(4).tolist()]}).encode()
    board = tomli_w.dumps(
        {
            "board": {
                "squares_across": 7,
                "squares_down": 5,
                "square_mm": 40.0,
                "marker_mm": 30.0,
                "dictionary": "5x5_100",
            },
            "nominal_square_mm": 40.0,
            "measured": True,
        }
    ).encode()
    pictures = (
        setup.replace(b'kind = "points"\nsize = "unknown"', real_views.ARUCO.encode())
        .replace(b"640", b"32")
        .replace(b"480", b"32")
    )
    pose = json.dumps({"image": "one.png", **real_views.as_told(real_views.X_BF[0])}).encode()
    card = (files_of("scooping", "checkpoints") / "default" / CARD).read_bytes()
    world = next(path for path in sorted(files_of("scooping", "worlds").glob("*.toml")))
    pendulum = files_of("pendulum", "checkpoints") / "default" / "model.safetensors"
    urdf = b'<robot name="r"><link name="a"/><link name="b"/><joint name="j" type="revolute"><parent link="a"/>'
    urdf += b'<child link="b"/><origin xyz="0 0 1" rpy="0 0 0"/><axis xyz="0 0 1"/></joint></robot>'
    arm = setup.replace(b'camera = "fixed"\n', b'camera = "fixed"\n', 1) + b'\n[kinematics]\nurdf = "robot.urdf"\n'
    numbers = json.dumps(
        {"q_rad": [0.1], "corners_px": json.loads(view)["corners_px"], "points_mm": json.loads(view)["points_mm"]}
    )
    return [
        Reader("setup.toml", setup, files.SETUP, lambda p: _beside(p, {"view-00.json": view})),
        Reader("view", view, "view-00.json", lambda p: _beside(p, {files.SETUP: setup})),
        Reader("picture", png, "one.png", lambda p: _beside(p, {files.SETUP: pictures, "view-00.json": pose})),
        Reader("urdf", urdf, "robot.urdf", lambda p: _beside(p, {files.SETUP: arm, "view-00.json": numbers.encode()})),
        Reader("touch.json", touch, files.TOUCH, lambda p: read(TouchRecord, p)),
        Reader(
            "calibration.json",
            calibration,
            "calibration.json",
            lambda p: read(SavedCalibration, p),
        ),
        Reader("board.toml", board, printing.BOARD_FILE, lambda p: printing.known(p.parent)),
        Reader("motion.json", b'{"frames": [], "arm_t_s": [0.0], "q_rad": [0.0]}', "motion.json", read_table),
        Reader("setup record", setup, "setup.toml", lambda p: read(SetupRecord, p)),
        Reader("world", world.read_bytes(), "world.toml", lambda p: load_world(str(p), get_task("scooping"))),
        Reader("rig", b"[arm]\nmodel = 'panda'\naddress = '10.0.0.2'\n", "rig.toml", reading.read),
        Reader("settings", b'task = "scooping"\nseed = 1\n', "adaptsim.toml", lambda p: config.load({}, {}, p.parent)),
        Reader(
            "object",
            b'task = "scooping"\nname = "own"\n[ranges]\nmu = [0.1, 0.4]\n',
            "object.toml",
            load_object,
        ),
        Reader("card", card, CARD, lambda p: read_card(p.parent, "scooping")),
        Reader("weights", pendulum.read_bytes(), "model.safetensors", load_tensors),
        Reader("log", lines, watching.FILE, lambda p: (watching.read(p.parent), watching.damage(p.parent))),
        Reader("session", b'format = 1\nname = "one"\ntask = "scooping"\n', "session.toml", _session),
    ]


def _silent() -> Any:
    return Screen(console=CleanConsole(file=io.StringIO()))


def _beside(path: Path, others: dict[str, bytes]) -> object:
    for name, content in others.items():
        (path.parent / name).write_bytes(content)
    stored = files.read_folder(path.parent)
    files.as_setup(stored.setup)
    return [view.record.flange() if not view.record.questions() else None for view in stored.views]


def _session(path: Path) -> object:
    folder = path.parent / "sessions" / "one"
    folder.mkdir(parents=True)
    path.rename(folder / "session.toml")
    return SessionStore.open(folder.parent, "one").facts


def changed(valid: bytes, file: str, rng: np.random.Generator) -> bytes:
    """The file with one to four changes."""
    data = valid
    for _ in range(int(rng.integers(1, 5))):
        data = (
            _structured(data, file, rng)
            if rng.random() < 0.6 and not file.endswith((".png", ".urdf"))
            else _bytes(data, rng)
        )
    return data


def _bytes(data: bytes, rng: np.random.Generator) -> bytes:
    a, b = sorted(int(k) for k in rng.integers(0, len(data) + 1, 2))
    kind = int(rng.integers(5))
    if kind == 0 and data:
        flipped = bytearray(data)
        flipped[int(rng.integers(len(data)))] ^= 1 << int(rng.integers(8))
        return bytes(flipped)
    if kind == 1:
        return data[:a] + data[b:]
    if kind == 2:
        return data[:b] + data[a:]
    if kind == 3:
        return data[:a]
    return data[:a] + TOKENS[int(rng.integers(len(TOKENS)))] + data[a:]


def _structured(data: bytes, file: str, rng: np.random.Generator) -> bytes:
    try:
        if file.endswith(".toml"):
            return tomli_w.dumps(_mutated(tomllib.loads(data.decode()), rng)).encode()
        if file.endswith(".json"):
            return json.dumps(_mutated(json.loads(data), rng)).encode()
    except (ValueError, TypeError, RecursionError, AttributeError):
        pass
    return _bytes(data, rng)


def _mutated(tree: Any, rng: np.random.Generator) -> Any:
    """The tree with one value, anywhere, replaced, removed, or given another key."""
    tree = copy.deepcopy(tree)
    at = tree
    while True:
        keys = list(at) if isinstance(at, dict) else list(range(len(at)))
        if not keys:
            return tree
        key = keys[int(rng.integers(len(keys)))]
        if isinstance(at[key], dict | list) and at[key] and rng.random() < 0.75:
            at = at[key]
            continue
        if rng.random() < 0.15:
            del at[key]
        elif rng.random() < 0.1 and isinstance(at, dict):
            at[f"{key}x"] = at.pop(key)
        else:
            at[key] = VALUES[int(rng.integers(len(VALUES)))]
        return tree


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=20.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--reader")
    parser.add_argument("--only", type=int, help="repeat this case of --reader")
    given = parser.parse_args()
    warnings.simplefilter("error", RuntimeWarning)
    chosen = [one for one in readers() if given.reader in (None, one.name)]
    for one in chosen:
        with tempfile.TemporaryDirectory() as made:
            (Path(made) / one.file).write_bytes(one.valid)
            try:
                one.load(Path(made) / one.file)
            except OURS as error:
                print(f"{one.name}: the unchanged file is refused: {str(error)[:200]}")
    until_s = time.monotonic() + 60 * given.minutes
    ran, refused, failed = Counter[str](), Counter[str](), Counter[str]()
    number = given.only or 0
    while time.monotonic() < until_s:
        for one in chosen:
            rng = np.random.default_rng([given.seed, number, sum(map(ord, one.name))])
            with tempfile.TemporaryDirectory() as made:
                path = Path(made) / one.file
                path.write_bytes(changed(one.valid, one.file, rng))
                try:
                    one.load(path)
                except OURS:
                    refused[one.name] += 1
                except Exception as error:  # noqa: BLE001 - what it looks for
                    failed[f"{one.name}: {type(error).__name__}"] += 1
                    if failed[f"{one.name}: {type(error).__name__}"] <= 2:
                        print(f"{one.name}, case {number}: {traceback.format_exc(limit=-4)}", flush=True)
            ran[one.name] += 1
        number += 1
        if given.only is not None:
            break
    print(f"{sum(ran.values())} cases, {sum(refused.values())} refused, {sum(failed.values())} tracebacks")
    for name, count in ran.items():
        print(f"  {name}: {count} cases, {refused[name]} refused")
    for name, count in failed.items():
        print(f"  TRACEBACK {name}: {count}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
