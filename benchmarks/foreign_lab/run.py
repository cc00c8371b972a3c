"""Sessions in a lab that shares no code with the product: `python benchmarks/foreign_lab/run.py --out foreign`.

Starts the arm (franky-sim's FR3 over its network protocol) and the camera (MuJoCo's renderer), then types the commands
of the operator's guide: doctor, calibrate, touch-off, run-iteration. OUT/transcript.txt has the whole dialogue, and
OUT/found.json the truth beside the results. A completed step is not repeated, so a run that failed can continue.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from datetime import date
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import person
import postures
from world import START_RAD, TRUTH, Line, Room, Truth, camera_pose, table_height_m

HERE = Path(__file__).parent
RIG = """\
name = "foreign"
consent = "command"
[arm]
model = "fr3"
address = "{host}"
[person]
side = "left"
[tools.scooping.payload]
mass_kg = 0.12
com_F_m = [0.02, -0.02, 0.17]
[tools.pushing.payload]
mass_kg = 0.15
com_F_m = [0.02, -0.02, 0.12]
[tools.board.payload]
mass_kg = 0.45
com_F_m = [0.0, 0.0, 0.22]
"""
WAIVERS = "".join(
    f'[[waivers]]\nsafeguard = "{name}"\nreason = "the whole lab is simulated"\nby = "Kim"\non = {date.today()}\n'
    for name in ("pedal", "keep_out", "stop_button", "slow_start")
)
HOST, BOARD_MM = "127.77.0.2", "259.4"
VIEWS = 22
CLOSING_S = 2.0


def main() -> None:
    options = parse()
    out: Path = options.out.absolute()
    out.mkdir(parents=True, exist_ok=True)
    lab = Lab(out, options.again)
    try:
        lab.open()
        lab.prepare()
        for task in options.task:
            if task == "scooping":  # a tool without corners cannot be touched off
                lab.touch_off(task)
            for number in range(options.sessions):
                lab.session(task, number + 1, options.iterations)
    finally:
        lab.close()


def parse() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("foreign"))
    parser.add_argument("--task", nargs="*", default=["scooping", "pushing"])
    parser.add_argument("--sessions", type=int, default=1)
    parser.add_argument("--iterations", type=int, default=5)
    parser.add_argument(
        "--again", action="store_true", help="calibrate once more, the arm visiting the views by itself"
    )
    return parser.parse_args()


class Lab:
    def __init__(self, out: Path, again: bool) -> None:
        self._again, self._out, self._log = again, out, out / "transcript.txt"
        self._processes: list[subprocess.Popen[str]] = []
        kept = {name: value for name, value in os.environ.items() if not name.startswith("ADAPTSIM_")}
        own = {"ADAPTSIM_HOME": str(out / "home"), "ADAPTSIM_RIG": str(out / "rig.toml")}
        self._environment = {**kept, **own, "TERM": "dumb", "COLUMNS": "400"}
        self._found = out / "found.json"
        self._board = out / "board.png"

    def open(self) -> None:
        """Print the board, switch on arm and camera."""
        (self._out / "rig.toml").write_text(RIG.format(host=HOST) + WAIVERS)
        if not self._board.exists():
            page = self._out / "page.png"
            self._alone("calibrate", "board", "--paper", "a4", "--out", str(page))
            self._alone("calibrate", "board", "--paper", "a4", "--out", str(page), "--width-mm", BOARD_MM)
            cv2.imwrite(str(self._board), cv2.resize(cv2.imread(str(page)), (1782, 1260), interpolation=cv2.INTER_AREA))
        self._start("arm.py", HOST, str(self._out), str(self._board))
        self._start("camera.py", str(self._out), str(self._board))
        self.arm = Line(self._out)

    def close(self) -> None:
        for process in self._processes:
            process.kill()
            process.wait()

    def prepare(self) -> None:
        """Doctor, calibration by hand, once more by the arm itself."""
        found = self._read()
        if "doctor" not in found:
            ended = self._run("scooping", ["doctor", "--hw", "fr3", "--json"])
            found["doctor"] = {"code": ended.code, "said": ended.data}
            self._write(found)
        if found.get("guided", {}).get("code") != 0:
            self.arm.ask(do="hold", what="board")
            ended = self._run("scooping", ["calibrate", "--hw", "fr3", "--guide", "--json"], guided=True)
            found["guided"] = self._judged(ended, calibration)
            self._write(found)
        if self._again and found.get("calibration", {}).get("code") != 0:
            self.arm.ask(do="hold", what="board")
            ended = self._run("scooping", ["calibrate", "--hw", "fr3", "--json"])
            found["calibration"] = self._judged(ended, calibration)
        self._write(found)
        if found.get("calibration", found["guided"])["code"] != 0:
            raise SystemExit("no calibration: see transcript.txt")

    def touch_off(self, task: str) -> None:
        """Set the task's tool down by hand, unless that is done; it stays in the hand."""
        found, name = self._read(), f"touch_off_{task}"
        if found.get(name, {}).get("code") != 0:
            ended = self._run(task, ["touch-off", "--task", task, "--hw", "fr3", "--json"], setting_down=True)
            found[name] = self._judged(ended, touch_off)
            self._write(found)
        if found[name]["code"] != 0:
            raise SystemExit(f"no touch-off of {task}: see transcript.txt")

    def session(self, task: str, number: int, iterations: int) -> None:
        name = f"{task}-{number}"
        self.arm.ask(do="hold", what="spatula" if task == "scooping" else "pusher", closed=True)
        time.sleep(CLOSING_S)
        for _ in range(iterations):
            found = self._read()
            done = found.setdefault("sessions", {}).setdefault(name, [])
            if sum(run["code"] == 0 for run in done) >= iterations:
                return
            began_s = time.monotonic()
            run = ["run-iteration", "--task", task, "--hw", "fr3", "--session", name, "--json"]
            ended = self._run(task, run, seed=number)
            done.append({"code": ended.code, "took_s": time.monotonic() - began_s, "said": ended.data[-1:]})
            self._write(found)
            if ended.code != 0:
                return

    def _judged(self, ended: person.Ended, judge: Any) -> dict[str, Any]:
        told = {"code": ended.code, "said": ended.said[-1500:] if ended.code else ""}
        return told | (judge(ended.data[-1], TRUTH) if ended.code == 0 and ended.data else {})

    def _run(
        self, task: str, arguments: list[str], *, seed: int = 0, guided: bool = False, setting_down: bool = False
    ) -> person.Ended:
        views = self._postures() if guided else []
        who = person.Person(self.arm, task, views, self._room("spatula") if setting_down else None, seed)
        ended = person.run(self._out, arguments, who, self._environment, self._log)
        sys.stdout.write(f"{arguments[0]} {' '.join(arguments[1:])}: exit code {ended.code}\n")
        sys.stdout.flush()
        return ended

    def _postures(self) -> list[list[float]]:
        kept = self._out / "postures.json"
        if not kept.exists():
            kept.write_text(json.dumps(postures.guided(self._room("board"), VIEWS)))
        found: list[list[float]] = json.loads(kept.read_text())
        return found

    def _room(self, held: str) -> Room:
        """The room as a person perceives it: a second model, in which nothing moves."""
        room = Room(TRUTH, None, self._out)
        room.build(START_RAD)
        room.hold(held)
        return room

    def _alone(self, *arguments: str) -> None:
        program = [sys.executable, "-c", "from adaptsim_cli.commands.app import main; main()", *arguments]
        subprocess.run(program, check=True, env=self._environment, cwd=self._out, stdout=subprocess.DEVNULL)

    def _start(self, script: str, *arguments: str) -> None:
        with (self._out / f"{script}.log").open("w") as log:
            process = subprocess.Popen(
                [sys.executable, str(HERE / script), *arguments], stdout=subprocess.PIPE, stderr=log, text=True
            )
        self._processes.append(process)
        assert process.stdout is not None
        if process.stdout.readline() != "ready\n":
            raise SystemExit(f"{script} did not start: see {self._out / script}.log")

    def _read(self) -> dict[str, Any]:
        found: dict[str, Any] = json.loads(self._found.read_text()) if self._found.exists() else {}
        return found

    def _write(self, found: dict[str, Any]) -> None:
        self._found.write_text(json.dumps(found, indent=1))


def calibration(said: dict[str, Any], truth: Truth) -> dict[str, Any]:
    """The camera's pose, the joints' zeros, and the error that the program stated."""
    X = np.array(said["X_BC"] if "X_BC" in said else said["X_AC"])
    true = camera_pose(truth)
    apart = X[:3, :3].T @ true[:3, :3]
    turned = np.degrees(np.arccos(np.clip((np.trace(apart) - 1.0) / 2.0, -1.0, 1.0)))
    off_mm = 1e3 * (X[:3, 3] - true[:3, 3])
    work = [
        1e3 * float(np.linalg.norm((X @ np.linalg.inv(true) @ [x, y, 0.02, 1.0])[:3] - [x, y, 0.02]))
        for x in (0.6, 0.8, 1.0)
        for y in (-0.2, 0.2)
    ]
    return {
        "off_mm": float(np.linalg.norm(off_mm)),
        "turned_deg": float(turned),
        "worst_work_mm": max(work),
        "stated_worst_95_mm": said.get("worst_95_mm"),
        "joint_offsets_mrad": said.get("joint_offsets_mrad"),
        "true_offsets_mrad": [1e3 * v for v in truth.joint_zero_rad],
        "views_used": len(said.get("views_used", [])),
        "views_rejected": said.get("views_rejected"),
        "checks": {c["name"]: [c["verdict"], c["message"]] for c in said.get("checks", [])},
    }


def touch_off(said: dict[str, Any], truth: Truth) -> dict[str, Any]:
    """Table and tool as the program believes, beside the truth."""
    true = {
        "table_height_mm": 1e3 * table_height_m(truth, 0.68, 0.0),
        "table_tilt_x_mm_m": 1e3 * truth.table_slope[0],
        "table_tilt_y_mm_m": 1e3 * truth.table_slope[1],
        "tool_height_mm": 1e3 * truth.tool_height_m,
        "tool_forward_mm": 1e3 * truth.tool_forward_m,
        "tool_pitch_deg": float(np.degrees(truth.tool_pitch_rad)),
        "tool_roll_deg": float(np.degrees(truth.tool_roll_rad)),
    }
    return {name: {"true": value, "believed": said[name]} for name, value in true.items()}


if __name__ == "__main__":
    main()
