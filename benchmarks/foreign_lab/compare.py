"""Truth against belief: what the program said of camera, table, tool and trials, beside what was so in the room.

python benchmarks/foreign_lab/compare.py FOLDER     the trials of all sessions in the FOLDER of run.py
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mcap.reader import make_reader
from world import Truth, camera_pose, table_height_m

from perception.blade import is_on_blade
from perception.types import ObjectTrack, Outcome
from sim.tasks import get_task

TIPPED_COS = np.cos(np.radians(30.0))
SEEN = 0.25  # least confidence of a frame whose place is compared


def calibration(said: dict[str, Any], truth: Truth) -> dict[str, Any]:
    """The camera's pose, the joints' zeros, and what the program took its error to be."""
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
    """Table and tool as believed, with what is true."""
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


@dataclass(frozen=True)
class Compared:
    """One trial: what was believed, and what was so."""

    session: str
    iteration: int
    number: int
    believed: Outcome
    true: Outcome
    reward: float
    true_reward: float
    apart_mm: np.ndarray  # (n,) of the frames in which the object was seen
    flags: tuple[str, ...]


def trials(folder: Path) -> Iterator[Compared]:
    """Every trial that counts, in the sessions of a folder."""
    films = [json.loads(line) for line in (folder / "truth.jsonl").read_text().splitlines()]
    for path in sorted((folder / "home/data/sessions").glob("*/iteration-*/trial-*/trial.json")):
        record, name = json.loads(path.read_text()), path.parts[-4]
        with (path.parent / "object.mcap").open("rb") as file:
            stamps_s = np.array([message.log_time for *_, message in make_reader(file).iter_messages()]) / 1e9
        film = next(film for film in films if film["t_s"][0] - 1e-4 <= stamps_s[0] <= film["t_s"][-1] + 1e-4)
        yield _compared(name, record, stamps_s, film)


def _compared(session: str, record: dict[str, Any], stamps_s: np.ndarray, film: dict[str, Any]) -> Compared:
    rows = [int(np.argmin(np.abs(np.array(film["t_s"]) - t))) for t in stamps_s]
    scooped = film["held"] == "spatula"
    poses = np.array(film["piece" if scooped else "bottle"])[rows]
    tool, track = np.array(film[film["held"]])[rows[-1]], record["track"]
    centres = poses[:, :, 3]
    in_tool = tool[:, :3].T @ (centres[-1] - tool[:, 3])
    if scooped:
        true = Outcome.ON_BLADE if is_on_blade(in_tool) else Outcome.ON_TABLE
    else:
        true = Outcome.UPRIGHT if poses[-1, 2, 2] > TIPPED_COS else Outcome.TIPPED
    task = get_task("scooping" if scooped else "pushing")
    so = ObjectTrack(np.array(track["t_s"]), centres, true, in_tool, np.ones(len(centres)))
    believed = np.array(track["state"])
    seen = np.array(track["confidence"]) >= SEEN
    apart_mm = 1e3 * np.linalg.norm(believed[:, :2] - centres[:, :2], axis=1)[seen]
    return Compared(
        session=session,
        iteration=record["iteration"],
        number=record["number"],
        believed=Outcome(record["outcome"]),
        true=true,
        reward=record["reward"],
        true_reward=task.score(so, np.array(record["context"])),
        apart_mm=apart_mm,
        flags=tuple(track["flags"]),
    )


def main(folder: str) -> None:
    found = list(trials(Path(folder)))
    print(f"{'trial':>16}  {'believed':>10} {'true':>10}  {'reward':>6} {'true':>5}  track, mm: median, 95 %  flags")
    for one in found:
        middle, most = np.percentile(one.apart_mm, (50, 95)) if len(one.apart_mm) else (np.nan, np.nan)
        print(
            f"{one.session + ' ' + str(one.number):>16}  {one.believed:>10} {one.true:>10}  {one.reward:6.2f} "
            f"{one.true_reward:5.2f}  {middle:17.1f} {most:5.1f}  {'; '.join(one.flags)}"
        )
    for name in dict.fromkeys(one.session for one in found):
        mine = [one for one in found if one.session == name]
        by_iteration = (
            np.mean([one.true_reward for one in mine if one.iteration == i])
            for i in sorted({one.iteration for one in mine})
        )
        print(f"{name}: true reward of the trials, by iteration: {', '.join(f'{r:.2f}' for r in by_iteration)}")
    apart = np.concatenate([one.apart_mm for one in found])
    off = np.array([one.reward - one.true_reward for one in found])
    print(
        f"{len(found)} trials: outcome right in {sum(one.believed == one.true for one in found)}; track "
        f"{np.median(apart):.1f} mm (median), {np.percentile(apart, 95):.1f} mm (95 %); reward off by "
        f"{np.abs(off).mean():.3f} on average, {np.abs(off).max():.3f} at most"
    )


if __name__ == "__main__":
    main(*sys.argv[1:])
