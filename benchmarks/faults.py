"""A campaign, with a seed, of faults of arm, pedal, hand, fingers, disk, process, clock, terminal, camera, session and
folder.

    PYTHONPATH=tests/support python benchmarks/faults.py --each 20 --pairs 40 --out faults.jsonl

Every kind is drawn until it changed the course `--each` times; a fault that changed nothing does not count (a wrong
stamp of an image counts if the image is in the film). Then, `--pairs` times, two faults at once are drawn.

A motion is one of an arm in a real lab: a trial, or a motion of the calibration with the board. Consent, pedal
protocol, checks, player and the pipe between them are the program's own, in simulated time; only the SDK is a stand-in
(`tests/support/living_sdk.py`), whose arm lags, coasts and has noise. Boxes stand as near to the motion as the program
accepts. The fingers have the program's keeper and pedal. A recording is one of the camera's driver over a stand-in of
libk4a. A session is a whole toy session that a fault stops at a random moment and that the same command continues. A
folder is somebody else's, whose rig file has the name of the lab and random gaps and waivers (`fault_folder.py`).

`--out` stores a line for each fault; the same command continues after the last one. `--share 1/3` makes only every
third fault of each kind, so that several processes share the work: name one `--out` each, and `--table` all of them.

After each fault:

* no command was beyond a limit, by code that shares nothing with the program: published limits, inertias and meshes
  (`tests/support/own_judge.py`, `mesh_judge.py`); the true surface stayed 10 mm from the box, 2 mm above the table, and
  off itself;
* the last command that differs came within what the documents promise (docs/results/motion.md);
* nothing was commanded without the typed model, and after a gap of more than 20 ms nothing more;
* the measured stop of an arm that coasts beyond the worst case reads BEYOND, whichever joint swings;
* a motion that did not end is remembered, and nothing moves before a recovery;
* a recording is an error, or each of its frames has its true time and at most a quarter of them is missing;
* in somebody else's folder no device is opened before a person confirms its files, their waivers never count, and
  another content or place asks again;
* of a session no completed trial changed, none is missing and none counted twice.
"""

from __future__ import annotations

import argparse
import gc
import json
import os
import signal
import sys
import tempfile
from collections.abc import Callable, Collection, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any
from zlib import crc32

import fake_k4a
import numpy as np
import toy_rig
import toy_session
from camera_stage import DELAY_S, Shown
from fake_k4a import PERIOD_S, FakeK4a, running
from fault_folder import FOLDERS, one_folder
from fault_hand import HAND_FAULTS, one_hand
from fault_lab import DISKS, HANDS, TYPED, Outcome, one_motion
from fault_stop import COASTING, one_stop
from fault_world import BEFORE, ESTIMATES, IN_MOTION, Fault, release
from kept import Kept
from toy_rig import ToyLab

from adaptsim_cli.errors import CliError
from adaptsim_cli.session import running as session_running
from hw.errors import ArmFault, CameraError, HardwareError, StoppedByPedal

MOST_TRIES = 6
"""Each kind is drawn at most this many times `--each`."""


SESSION_ERRORS: dict[str, Callable[[], BaseException]] = {
    "session: reflex": lambda: ArmFault("joint_reflex"),
    "session: pedal": lambda: StoppedByPedal("the enabling pedal was released"),
    "session: camera": lambda: CameraError("no frame within 1 s"),
    "session: Ctrl-C": KeyboardInterrupt,
}
HOOKS = ("place", "snapshot", "execute", "stop_recording")


def one_session(kind: str, rng: np.random.Generator, home: Path) -> Outcome:
    """Two trials; the fault comes at the n-th call of one of the lab's hooks, then the same command goes on."""
    hook, at, calls = str(rng.choice(HOOKS)), int(rng.integers(1, 7)), 0

    def fail(trial: int, attempt: int) -> None:
        nonlocal calls
        calls += 1
        if calls != at:
            return
        if kind == "session: killed":
            os.kill(os.getpid(), signal.SIGKILL)
        raise SESSION_ERRORS[kind]()

    child = os.fork() if kind == "session: killed" else -1
    stopped = False
    if child <= 0:
        try:
            run(home, ToyLab(7, {hook: fail}))
        except (HardwareError, CliError, KeyboardInterrupt):
            stopped = True
        if child == 0:
            os._exit(0)
    if child > 0:
        stopped = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == -signal.SIGKILL
    before = completed(home)
    notes: list[str] = []
    if stopped:
        try:
            run(home, ToyLab(7))
        except (HardwareError, CliError) as error:
            notes.append(f"the same command did not go on: {error}")
    after = completed(home)
    notes += [f"{name} changed or is gone" for name, content in before.items() if after.get(name) != content]
    trials = sorted({Path(name).parent.name.split("-attempt")[0] for name in after})
    folders = {Path(name).parent.name for name in after}
    if trials != ["trial-001", "trial-002"] or len(folders) != 2:
        notes.append(f"trials are {sorted(folders)}")
    return Outcome(kind, stopped, notes)


FRAMES = 30
LATENCY_S = DELAY_S - 0.5 * 8330e-6
SKIPS_S = (-3600.0, -120.0, -5.0, -0.3, -0.05, 0.05, 0.3, 5.0, 120.0, 1.7e9)
CAMERAS = (
    "camera: unplugged",
    "camera: silent",
    "camera: no colour",
    "camera: lost frames",
    "camera: late",
    "camera: clock skips",
    "camera: unstamped",
)


def one_camera(kind: str, rng: np.random.Generator) -> Outcome:
    """A recording of `FRAMES` images, each with its number as its depth; the fault comes at one of them."""
    fake, at, count = FakeK4a("A1"), int(rng.integers(1, FRAMES)), int(rng.integers(1, 15))
    boot_s, skip_s = fake_k4a.BOOT_S, float(rng.choice(SKIPS_S))
    try:
        with running(fake, latency_s=LATENCY_S) as camera:
            camera.start_recording()
            start_s = fake.clock.now_s() + 0.01
            for i in range(FRAMES):
                during = at <= i < at + count
                if kind in CAMERAS[:2] and i == at:
                    for _ in range(1 if kind == CAMERAS[0] else 4):
                        fake.fail("unplugged" if kind == CAMERAS[0] else "timeout")
                    break
                if kind == "camera: clock skips" and i == at:
                    fake_k4a.BOOT_S = boot_s - skip_s
                if kind == "camera: lost frames" and during:
                    fake.clock.advance_to(start_s + i * PERIOD_S + DELAY_S)
                    continue
                fake.show(
                    Shown(
                        start_s + i * PERIOD_S,
                        late_s=0.2 if kind == "camera: late" and during else 0.0,
                        depth_mm=500 + i,
                        has_colour=not (
                            kind == "camera: no colour" and during and (i - at) % 4
                        ),  # four in a row: it is gone
                        stamped=not (kind == "camera: unstamped" and during),
                    )
                )
            try:
                film = _shown_meanwhile(fake, camera.stop_recording, kind in CAMERAS[:2])
            except HardwareError:
                return Outcome(kind, True, [])
    finally:
        fake_k4a.BOOT_S = boot_s
    if film is None:
        return Outcome(kind, True, ["the recording never ended"])
    numbers = [int(frame.depth_mm[0, 0]) - 500 for frame in film]
    off_s = [abs(frame.t_s - start_s - i * PERIOD_S) for i, frame in zip(numbers, film, strict=True)]
    notes = [f"a frame {max(off_s):.3f} s off (skip {skip_s:g} s, image {at})"] if max(off_s) > 0.02 else []
    whole = {i for i in numbers if i < FRAMES}
    if len(whole) < 0.7 * FRAMES:  # the driver counts those after them too
        notes.append(f"{FRAMES - len(whole)} of {FRAMES} images are missing and nothing is said")
    stamped_wrong = kind in ("camera: late", "camera: unstamped") and any(at <= i < at + count for i in whole)
    return Outcome(kind, len(whole) < FRAMES or max(off_s) > 1e-4 or stamped_wrong, notes)


def _shown_meanwhile(fake: FakeK4a, ask: Callable[[], Any], is_gone: bool) -> Any:
    """What the camera answers while it shows more images; None: nothing after 90 of them."""
    fake.clock.asked.clear()
    with ThreadPoolExecutor(1) as pool:
        answer: Future[Any] = pool.submit(ask)
        fake.clock.asked.wait()
        for i in range(90):
            if is_gone or answer.done():
                return answer.result()
            fake.show(Shown(fake.clock.now_s() + 0.003, depth_mm=500 + FRAMES + i))
            wait([answer], 0.1)  # a busy computer
        fake.end()
        return None


def run(home: Path, lab: ToyLab) -> None:
    """One iteration of one particle, as `run-iteration --yes`."""
    settings = toy_session.resolved(home, particles=1)
    request = session_running.SessionRequest(None, frozenset({"task"}), 1, yes=True)
    session_running.run_session(
        settings, request, toy_rig.opener(lab), lambda store: store.folder, toy_session.silent()
    )


def completed(home: Path) -> dict[str, bytes]:
    """Every file of every completed trial."""
    root = home / "data" / "sessions"
    records = root.glob("*/iteration-01/*/trial.json")
    return {str(p.relative_to(root)): p.read_bytes() for record in records for p in sorted(record.parent.iterdir())}


MOTIONS = ("trial", "calibration")
SESSIONS = (*SESSION_ERRORS, "session: killed")
ARM_KINDS = tuple(dict.fromkeys((*IN_MOTION, *BEFORE, *TYPED, *HANDS, *DISKS)))
PAIR = "two at once"
KINDS = (*ARM_KINDS, COASTING, *HAND_FAULTS, *CAMERAS, *SESSIONS, *FOLDERS)
"""Every kind of fault, in the order of the table."""


def one_arm(kind: str, number: int, rng: np.random.Generator, folder: Path) -> Outcome:
    """The motion of that number with a fault of that kind: motions and moments in turn."""
    model = ("panda", "fr3", "fr3v2")[int(rng.integers(3))]
    motion = "trial" if kind in HANDS else MOTIONS[number % len(MOTIONS)]
    whens = [when for when in (1, 1, -1, 0) if kind in (IN_MOTION if when > 0 else BEFORE)]
    if kind in ("arm: heavier", "arm: guided", *ESTIMATES):
        whens = [-1]  # nobody checks load and estimate again after the check, and a guided arm plays nothing

    def faults(length: int) -> tuple[tuple[int, Fault], ...]:
        at = int(rng.integers(1, int(0.9 * length)))
        if kind == DISKS[1]:
            return ((at, release),)  # the reason of the stop cannot be written
        if not whens:
            return ()
        when = whens[number // len(MOTIONS) % len(whens)]
        return ((at, IN_MOTION[kind]),) if when > 0 else ((when, BEFORE[kind]),)

    return one_motion((kind,), faults, motion, model, rng, folder)


def one_pair(number: int, rng: np.random.Generator, folder: Path) -> Outcome:
    """Two different faults of one motion, the second up to 0.3 s after the first, or both before it."""
    names = tuple(str(name) for name in rng.choice(list(IN_MOTION), 2, replace=False))

    def faults(length: int) -> tuple[tuple[int, Fault], ...]:
        at = int(rng.integers(1, length // 2))
        return (at, IN_MOTION[names[0]]), (at + int(rng.integers(0, 300)), IN_MOTION[names[1]])

    made = one_motion(names, faults, MOTIONS[number % len(MOTIONS)], ("panda", "fr3", "fr3v2")[number % 3], rng, folder)
    made.kind = f"{PAIR}: {made.kind}"
    return made


def one(kind: str, number: int, seed: int) -> dict[str, Any]:
    """The fault of that kind and number, with a seed of its own."""
    rng = np.random.default_rng([seed, crc32(kind.encode()), number])
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        parts: list[tuple[Collection[str], Callable[[], Outcome]]] = [
            (CAMERAS, lambda: one_camera(kind, rng)),
            (SESSIONS, lambda: one_session(kind, rng, folder)),
            (HAND_FAULTS, lambda: one_hand(kind, rng)),
            ({COASTING}, lambda: one_stop(number, rng)),
            (FOLDERS, lambda: one_folder(kind, rng, folder)),
            ({PAIR}, lambda: one_pair(number, rng, folder)),
            (ARM_KINDS, lambda: one_arm(kind, number, rng, folder)),
        ]
        return asdict(next(play for kinds, play in parts if kind in kinds)())


def campaign(each: int, pairs: int, seed: int, store: Kept, share: tuple[int, int] = (1, 1)) -> Iterator[Outcome]:
    """Every kind until it had an effect `each` times, then `pairs` of two faults; only a share (k of n) of all."""
    part, parts = share
    for kind, least in [*((kind, each) for kind in KINDS), (PAIR, pairs)]:
        effective = 0
        wanted = -(-least // parts)
        for number in range(part - 1, MOST_TRIES * least, parts):
            if effective >= wanted:
                break
            outcome = Outcome(**store.row(kind, number, partial(one, kind, number, seed)))
            effective += outcome.effective
            yield outcome


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--each", type=int, default=20, help="effective faults of every kind")
    parser.add_argument("--pairs", type=int, default=40, help="effective pairs of faults")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--share", default="1/1", help="k/n: this process makes every n-th fault, from the k-th")
    parser.add_argument("--out", type=Path)
    parser.add_argument("--table", type=Path, nargs="+", help="print the table of these files and make nothing")
    asked = parser.parse_args()
    if asked.table:
        return table([Outcome(**json.loads(line)["row"]) for path in asked.table for line in path.open()])
    gc.freeze()  # a player collects garbage before every motion: only what is new
    part, parts = (int(number) for number in asked.share.split("/"))
    outcomes = []
    for outcome in campaign(asked.each, asked.pairs, asked.seed, Kept(asked.out), (part, parts)):
        outcomes.append(outcome)
        for note in outcome.wrong:
            print(f"WRONG {outcome.kind}, {outcome.motion}: {note}", flush=True)
        if len(outcomes) % 50 == 0:
            print(summary(outcomes), flush=True)
    return table(outcomes)


def table(outcomes: list[Outcome]) -> int:
    """Print a row per kind, the broken promises, and the sum."""
    print("| kind | effective of drawn | trial, calibration | at rest within | broke a promise |")
    print("|---|---|---|---|---|")
    by_kind: dict[str, list[Outcome]] = {}
    for outcome in outcomes:
        by_kind.setdefault(PAIR if outcome.kind.startswith(PAIR) else outcome.kind, []).append(outcome)
    for kind, rows in by_kind.items():
        effective = [row for row in rows if row.effective]
        motions = [sum(row.motion == motion for row in effective) for motion in MOTIONS]
        where = ", ".join(map(str, motions)) if sum(motions) else ""
        slowest_s = max((row.stop_s for row in rows), default=0.0)
        rest = f"{slowest_s:.3f} s" if slowest_s else ""
        print(f"| {kind} | {len(effective)} of {len(rows)} | {where} | {rest} | {sum(bool(r.wrong) for r in rows)} |")
    print(f"\n{summary(outcomes)}")
    broken = [f"{row.kind}, {row.motion}: {note}" for row in outcomes for note in row.wrong]
    print("".join(f"WRONG {text}\n" for text in broken), end="")
    return 1 if broken else 0


def summary(outcomes: list[Outcome]) -> str:
    effective, broken = sum(row.effective for row in outcomes), sum(bool(row.wrong) for row in outcomes)
    return f"{len(outcomes)} faults, {effective} effective, {broken} broke a promise"


if __name__ == "__main__":
    sys.exit(main())
