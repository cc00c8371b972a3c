"""Damaged and hostile files for every reader of files that people or devices write: one error each, never a traceback.

    PYTHONPATH=tests/support python benchmarks/fuzz.py [--minutes 20] [--seed 0] [--reader NAME]

Each case takes a valid file and changes it: bytes flipped, cut, doubled or replaced by awkward tokens; in TOML and JSON
also values replaced and keys removed or renamed. A reader may accept it or raise an error of this program. Anything
else is printed with its reader and number. To repeat it: `--only NUMBER --reader NAME`.

Seed 55, 60 minutes: 1,133,550 cases of 33 kinds of files, one traceback, fixed (links of a URDF in a circle took all
memory; a case may take 8 GB). Seed 8129: 106,964 cases, one traceback, fixed. Seed 9013: 191,114 cases, none.
"""

from __future__ import annotations

import argparse
import copy
import json
import os
import resource
import shutil
import sys
import tempfile
import time
import tomllib
import traceback
import warnings
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import tomli_w

sys.path.append(str(Path(__file__).parents[1] / "tests" / "support"))
import kinect_files
import real_views
import recordings
import toy_session
from kinect_recording import camera_model

from adaptsim_cli import config
from adaptsim_cli.bench.calibration import checking, printing
from adaptsim_cli.bench.calibration.solving import solve_folder
from adaptsim_cli.bench.devices.known_arm import KnownArm
from adaptsim_cli.bench.rig_file import reading
from adaptsim_cli.bench.touch_off import store as touch_offs
from adaptsim_cli.errors import CliError
from adaptsim_cli.screen import log
from adaptsim_cli.screen.outputs.exchange import Question
from adaptsim_cli.session import recording, watching
from adaptsim_cli.session.own.reading import read_answer, track_of
from adaptsim_cli.session.recorded.folder import read_recorded
from adaptsim_cli.session.store import SessionStore
from adaptsim_cli.storage import durable
from calib import files
from calib.errors import CalibrationError
from calib.foreign.chains import any_arm
from calib.records import SetupRecord, TouchRecord, read
from calib.saved import SavedCalibration
from hw.bounded import Unreadable
from hw.errors import HardwareError
from perception.errors import PerceptionError
from sim.adaptation.card import CARD, read_card
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
    b"nan", b"inf", b"-", b"1e999", b"[[", b"]", b"{", b'"', b"\x00", b"\xff\xfe", b"9" * 400, b"\\u0000", b"\n", b"=",
)  # fmt: skip


@dataclass(frozen=True)
class Reader:
    """One kind of file."""

    name: str
    valid: bytes
    file: str  # its name
    load: Callable[[Path], object]  # reads the file at this path
    seal: Callable[[bytes], bytes] = bytes  # of a record with a checksum, so that damage goes beyond it


def readers(made: Path) -> list[Reader]:
    """All readers, each with a valid file. Further files that these need are written into the folder `made`."""
    folder = real_views.corner_folder(made / "views")
    setup, view = (folder / files.SETUP).read_bytes(), (folder / "view-00.json").read_bytes()
    calibration = solve_folder(folder, created="2026-01-01").record.content()
    written = watching.SessionLog(folder, toy_session.silent())
    for number in range(3):
        written.noted(f"line {number}")
    lines = (folder / log.FILE).read_bytes()
    png = cv2.imencode(".png", np.arange(3072).astype(np.uint8).reshape(32, 32, 3))[1].tobytes()
    pictures = f'camera = "fixed"\n[board]\n{real_views.ARUCO}\n[colour]\nwidth = 32\nheight = 32\n{SMALL_K}\n'
    pose = json.dumps({"image": "one.png", **real_views.as_told(real_views.X_BF[0])}).encode()
    card = (files_of("scooping", "checkpoints") / "default" / CARD).read_bytes()
    world = next(path for path in sorted(files_of("scooping", "worlds").glob("*.toml")))
    pendulum = files_of("pendulum", "checkpoints") / "default" / "model.safetensors"
    urdf = b'<robot name="r"><link name="a"/><link name="b"/><joint name="j" type="revolute"><parent link="a"/>'
    urdf += b'<child link="b"/><origin xyz="0 0 1" rpy="0 0 0"/><axis xyz="0 0 1"/></joint></robot>'
    arm = setup + b'\n[kinematics]\nurdf = "robot.urdf"\n'
    places = {key: json.loads(view)[key] for key in ("corners_px", "points_mm")}
    numbers = json.dumps({"q_rad": [0.1], **places}).encode()
    touch = json.dumps({"image": "touch.png", "corner": 0, "X_BF": [np.eye(4).tolist()]}).encode()
    tables = recordings.write_tables(made / "tables", 8)
    known = {"stop_button": "2026-01-01T00:00:00+00:00", "stop_button_by": "Ada", "slow_motions": [], "steps": []}
    motion = {"frames": [], "arm_t_s": [0.0, 0.01], "q_rad": [[0.0] * 7, [0.01] * 7]}
    touched = json.dumps(TOUCH_OFF).encode()
    return [
        Reader("setup.toml", setup, files.SETUP, lambda p: _beside(p, {"view-00.json": view})),
        Reader("view", view, "view-00.json", lambda p: _beside(p, {files.SETUP: setup})),
        Reader("picture", png, "one.png", lambda p: _beside(p, {files.SETUP: pictures.encode(), "view-00.json": pose})),
        Reader("urdf", urdf, "robot.urdf", lambda p: _beside(p, {files.SETUP: arm, "view-00.json": numbers})),
        Reader("touch.json", touch, files.TOUCH, lambda p: read(TouchRecord, p)),
        Reader("calibration.json", calibration, "calibration.json", lambda p: read(SavedCalibration, p)),
        Reader("touch-off.json", touched, touch_offs.FILE, lambda p: read(touch_offs.SavedTouchOff, p)),
        Reader("board.toml", BOARD, printing.BOARD_FILE, lambda p: printing.stored_board(p.parent)),
        Reader("motion.json", json.dumps(motion).encode(), checking.MOTION, checking.read_motion),
        Reader("setup record", setup, "setup.toml", lambda p: read(SetupRecord, p)),
        Reader("world", world.read_bytes(), "world.toml", lambda p: load_world(str(p), get_task("scooping"))),
        Reader("rig", RIG, "rig.toml", reading.read),
        Reader("known arm", json.dumps(known).encode(), "known.json", lambda p: KnownArm(p.parent).read()),
        Reader("last motion", b"{}", "last-motion.json", lambda p: KnownArm(p.parent).unended()),
        Reader("settings", b'task = "scooping"\nseed = 1\n', "adaptsim.toml", lambda p: config.load({}, {}, p.parent)),
        Reader("object", b'task = "scooping"\nname = "own"\n[ranges]\nmu = [0.1, 0.4]\n', "object.toml", load_object),
        Reader("card", card, CARD, lambda p: read_card(p.parent, "scooping")),
        Reader("weights", pendulum.read_bytes(), "model.safetensors", load_tensors),
        Reader("log", lines, log.FILE, lambda p: log.read(p.parent)),
        _answer(),
        *(_of_tables(tables, name) for name in ("recorded.toml", "trials.csv", "trajectories.csv")),
        *_of_others(made),
        *_of_session(made / "session"),
    ]


SMALL_K = "K = [[30.0, 0.0, 16.0], [0.0, 30.0, 16.0], [0.0, 0.0, 1.0]]"
BOARD = b"""nominal_square_mm = 40.0
measured = true
[board]
squares_across = 7
squares_down = 5
square_mm = 40.0
marker_mm = 30.0
dictionary = "5x5_100"
"""
RIG = b"name = 'lab'\n[arm]\nmodel = 'panda'\naddress = '10.0.0.2'\n"


def _estimate(value: float) -> dict[str, Any]:
    return dict.fromkeys(("value", "within"), value)


_TOUCHED = ["table_height_m", "tilt_x", "tilt_y", "tool_height_m", "tool_forward_m", "tool_pitch_rad", "tool_roll_rad"]
_LENGTHS = ["table_origin_m", "edge_over_table_m", "edge_too_high_m", "repeat_m", "misfit_m"]
TOUCH_OFF = {
    **dict.fromkeys(["created", "hw", "arm", "rig", "tool", "source"], "one"),
    **{name: _estimate(0.001) for name in _TOUCHED},
    **dict.fromkeys(_LENGTHS, 0.001),
    "slip": dict.fromkeys(["moved_m", "pressed_N", "grasp_force_N"], 0.001),
    "joint_zeros_rad": [0.0] * 7,
    "touches": [],
    "versions": {},
}


def _beside(path: Path, others: dict[str, bytes]) -> object:
    for name, content in others.items():
        (path.parent / name).write_bytes(content)
    stored = files.read_folder(path.parent, any_arm)
    files.as_setup(stored.setup)
    return [view.record.flange() if not view.record.questions() else None for view in stored.views]


def _of_tables(folder: Path, name: str) -> Reader:
    """One file of recorded trials, beside the others."""

    def load(path: Path) -> object:
        for other in folder.iterdir():
            if other.name != name:
                os.link(other, path.parent / other.name)
        return read_recorded(get_task("pendulum"), path.parent)

    return Reader(name, (folder / name).read_bytes(), name, load)


def _answer() -> Reader:
    """The answer of an own robot about a push, with its whole trajectory."""
    task = get_task("pushing")
    report, standing = task.require_report(), task.require_hardware().standing
    assert standing is not None, "a bottle stands on a mark"
    x_m, y_m = standing.mark_m
    middle = {d.name: 0.5 * (d.low + d.high) for space in (task.context, task.action) for d in space.dimensions}
    question = Question(
        ask="trial", session="s", task="pushing", trial=3, attempt=1, goal_m=(0.83, 0.02), units={}, needs=(),
        context={name: middle[name] for name in task.context.names},
        action={name: middle[name] for name in task.action.names},
        times_s=tuple(task.observation.times_s.tolist()), state=report.columns, outcomes=report.outcomes, success=(),
    )  # fmt: skip
    t_s = np.arange(0.0, 2.0, 0.05)
    state = np.c_[x_m + 0.2 * np.clip(t_s - 0.4, 0.0, 1.0), np.full_like(t_s, y_m), np.full_like(t_s, 0.05)]
    table = {"trial": 3, "outcome": "upright", "t_s": t_s.tolist(), "state": state.tolist(), "rest_s": 1.5}

    def load(path: Path) -> object:
        return track_of(read_answer(path.read_bytes(), question), question, task)

    return Reader("answer", json.dumps(table).encode(), "trial.answer.json", load)


PAIRS = b"camera = 'fixed'\n[board]\nkind = 'points'\n[colour]\nwidth = 32\nheight = 32\n"


def _of_others(made: Path) -> list[Reader]:
    """Files of other programs: pairs of poses, MCAP of ROS 2 messages, Parquet, a Kinect's calibration."""
    target = {"target_position_m": [0, 0, 1], "target_quaternion_xyzw": [0, 0, 0, 1]}
    pair = json.dumps({"X_BF": np.eye(4).tolist(), **target})
    bags, tables = recordings.write_mcap(made / "bags", 8), recordings.write_tables(made / "parquet", 8)
    return [
        Reader(
            "pose pair", pair.encode(), "view-00.json", lambda p: _beside(p, {files.SETUP: PAIRS + SMALL_K.encode()})
        ),
        Reader(
            "setup of pairs",
            PAIRS + SMALL_K.encode(),
            files.SETUP,
            lambda p: _beside(p, {"view-00.json": pair.encode()}),
        ),
        replace(_of_tables(bags, "swing-03.mcap"), name="foreign mcap"),
        replace(_of_tables(bags, "recorded.toml"), name="manifest of mcap"),
        *_of_parquet(tables),
        Reader(
            "kinect's calibration",
            kinect_files.CALIBRATION.read_bytes(),
            "calibration.json",
            lambda p: camera_model(p.read_bytes(), "720P", "NFOV_UNBINNED"),
        ),
    ]


def _of_parquet(tables: Path) -> list[Reader]:
    """The samples as Parquet; none without the extra `export`."""
    if find_spec("pyarrow") is None:
        return []
    from pyarrow import csv, parquet  # noqa: PLC0415

    text = (tables / "recorded.toml").read_text().replace("[tables]", '[tables]\ntrajectories = "t.parquet"')
    (tables / "recorded.toml").write_text(text)
    parquet.write_table(csv.read_csv(tables / "trajectories.csv"), tables / "t.parquet")
    return [replace(_of_tables(tables, "t.parquet"), name="parquet")]


def _of_session(home: Path) -> list[Reader]:
    """Every record of a session, sealed again after the damage, and a recording."""
    root = toy_session.run(home).folder
    first = "iteration-01/trial-001-attempt-1"
    records = ("session.toml", "start.json", f"{first}/motion.json", f"{first}/trial.json")
    found = [_record_of(root, name) for name in (*records, "iteration-01/result-1/result.json")]
    mcap = root / first / "recording.mcap"
    return [*found, Reader("recording", mcap.read_bytes(), mcap.name, recording.read)]


def _record_of(root: Path, name: str) -> Reader:
    content = (root / name).read_bytes()
    seal, mark = (
        (durable.seal_toml, b"# sha256 ") if name.endswith(".toml") else (durable.seal_json, b',\n "sealed": "')
    )
    body = content[: content.rindex(mark)] + (b"" if name.endswith(".toml") else b"\n}\n")

    def load(path: Path) -> object:
        folder = path.parent / "sessions" / root.name
        shutil.copytree(root, folder, copy_function=os.link)
        path.replace(folder / name)
        store = SessionStore.open(folder.parent, root.name)
        (key, *_) = sorted(store.existing().completed)
        return store.trials(0), store.motion(0, key), store.result(0)

    return Reader(f"session's {Path(name).name}", body, Path(name).name, load, seal)


def changed(valid: bytes, file: str, rng: np.random.Generator) -> bytes:
    """The file with one, two or four changes."""
    data = valid
    for _ in range(int(rng.choice([1, 1, 2, 4]))):
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


MOST_BYTES = 8 * 2**30
"""Of memory: a reader that wants more raises MemoryError, which counts as a traceback."""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=20.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--reader")
    parser.add_argument("--only", type=int, help="repeat this case of --reader")
    given = parser.parse_args()
    warnings.simplefilter("error", RuntimeWarning)
    resource.setrlimit(resource.RLIMIT_AS, (MOST_BYTES, MOST_BYTES))
    kept = tempfile.TemporaryDirectory()
    chosen = [one for one in readers(Path(kept.name)) if given.reader in (None, one.name)]
    for one in chosen:
        with tempfile.TemporaryDirectory() as made:
            (Path(made) / one.file).write_bytes(one.seal(one.valid))
            one.load(Path(made) / one.file)  # a file that is refused unchanged tests nothing: this ends the program
    until_s = time.monotonic() + 60 * given.minutes
    ran, refused, failed = Counter[str](), Counter[str](), Counter[str]()
    number = given.only or 0
    while time.monotonic() < until_s:
        for one in chosen:
            rng = np.random.default_rng([given.seed, number, sum(map(ord, one.name))])
            with tempfile.TemporaryDirectory() as made:
                path = Path(made) / one.file
                path.write_bytes(one.seal(changed(one.valid, one.file, rng)))
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
