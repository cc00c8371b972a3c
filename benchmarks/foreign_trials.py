"""The trials of the foreign lab, as tracked and judged by the program and as they truly were.

python benchmarks/foreign_lab/run.py --out foreign --task scooping pushing --sessions 3
python benchmarks/foreign_trials.py foreign
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mcap.reader import make_reader

from perception.types import ObjectTrack, Outcome, is_on_blade
from sim.tasks import get_task

TIPPED_COS = np.cos(np.radians(30.0))
SEEN = 0.25  # least confidence of a frame whose place is compared


@dataclass(frozen=True)
class Compared:
    """One trial: what was believed, and what was so."""

    session: str
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
        number=record["number"],
        believed=Outcome(record["outcome"]),
        true=true,
        reward=record["reward"],
        true_reward=task.score(so, np.array(record["context"])),
        apart_mm=apart_mm,
        flags=tuple(track["flags"]),
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="--out of run.py")
    found = list(trials(parser.parse_args().folder))
    print(f"{'trial':>16}  {'believed':>10} {'true':>10}  {'reward':>6} {'true':>5}  track, mm: median, 95 %  flags")
    for one in found:
        middle, most = np.percentile(one.apart_mm, (50, 95)) if len(one.apart_mm) else (np.nan, np.nan)
        print(
            f"{one.session + ' ' + str(one.number):>16}  {one.believed:>10} {one.true:>10}  {one.reward:6.2f} "
            f"{one.true_reward:5.2f}  {middle:17.1f} {most:5.1f}  {'; '.join(one.flags)}"
        )
    apart = np.concatenate([one.apart_mm for one in found])
    off = np.array([one.reward - one.true_reward for one in found])
    print(
        f"{len(found)} trials: outcome right in {sum(one.believed == one.true for one in found)}; track "
        f"{np.median(apart):.1f} mm (median), {np.percentile(apart, 95):.1f} mm (95 %); reward off by "
        f"{np.abs(off).mean():.3f} on average, {np.abs(off).max():.3f} at most"
    )


if __name__ == "__main__":
    main()
