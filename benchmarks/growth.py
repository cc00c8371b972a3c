"""How time, memory and files grow with a session, with the stored sessions, and with a recording.

    python benchmarks/growth.py [--trials 4 20 100 400] [--sessions 10 1000] [--frames 30 300] [--plot FIGURE.png]

Prints seconds of the processor, not of the clock, so other work on the computer hardly matters. A session is one of the
pendulum, where nothing is filmed: so only learning, reading and drawing grow.
"""

from __future__ import annotations

import argparse
import os
import resource
import shutil
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from io import StringIO
from pathlib import Path
from typing import TypeVar

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the program does

import numpy as np
from rich.console import Console

from adaptsim_cli import config
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.session import beginning, recording, records
from adaptsim_cli.session.flow import RunningSession, run_iteration
from adaptsim_cli.session.folders import names
from adaptsim_cli.session.opening import open_parts
from adaptsim_cli.session.operator import Unattended
from adaptsim_cli.session.summary import overview_or_damage
from adaptsim_cli.show.reports import Reports
from hw.records import AnyRecord
from hw.types import Execution, Frame
from sim.lab.kinect import kinect_model

T = TypeVar("T")
NEAR = 5
"""Iterations over which the time of one is averaged."""


@dataclass(frozen=True)
class Size:
    """A session at some size."""

    trials: int
    iteration_s: float  # mean of the last `NEAR` iterations
    report_s: float  # of a report, drawn after earlier ones
    page_mb: float
    opened: int  # records read by one iteration
    peak_mb: float  # of the process so far


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, nargs="*", default=[4, 20, 100, 400])
    parser.add_argument("--sessions", type=int, nargs="*", default=[10, 1000])
    parser.add_argument("--frames", type=int, nargs="*", default=[30, 300])
    parser.add_argument("--plot", type=Path, help="file of the figure")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as home:
        os.environ["ADAPTSIM_HOME"] = home
        session(sorted(args.trials), args.plot)
        root = config.load({"task": "pendulum"}).places.sessions
        for count in sorted(args.sessions):
            print(f"{count} stored sessions: `sessions list` takes {listed_s(root, count):.2f} s")
        for count in sorted(args.frames):
            print(f"a recording of {count} frames: {film(Path(home), count)}")


def cpu_s(work: Callable[[], T]) -> tuple[float, T]:
    """Seconds of the processor that `work` takes, and its result."""
    began = time.process_time()
    result = work()
    return time.process_time() - began, result


def session(sizes: Sequence[int], plot: Path | None) -> None:
    """One session, measured at every size; a report is drawn only there, and the figure is updated."""
    resolved = config.load({"task": "pendulum", "world": "wd", "seed": 0})
    screen, reports, rows = Screen(console=Console(file=StringIO(), width=80)), Reports(), list[Size]()
    opened, read = [0], records.read

    def counted(kind: type[AnyRecord], path: Path) -> AnyRecord:
        opened[0] += 1
        return read(kind, path)

    vars(records)["read"] = counted
    with open_parts(resolved.config, Path(os.environ["ADAPTSIM_HOME"]) / "learnt") as parts:
        store = beginning.begin(resolved.places.sessions, "grows", resolved.config, parts)
        running_session = RunningSession(store, parts, Unattended(screen), screen)
        each, took_s = store.facts.particles * store.facts.trials, list[float]()
        print("trials  iteration  report     page  records read  peak memory")
        for iteration in range(max(sizes, default=0) // each):
            before = opened[0]
            spent_s, _ = cpu_s(lambda: run_iteration(running_session))
            store.mark_shown(iteration, "measured")
            took_s.append(spent_s)
            if (trials := each * (iteration + 1)) in sizes:
                one = opened[0] - before
                reports.draw(store)  # the first one loads the checkpoint
                report_s, page = cpu_s(lambda: reports.draw(store))
                peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
                size_mb = page.stat().st_size / 1e6
                mean_s = float(np.mean(took_s[-NEAR:]))
                size = Size(trials, mean_s, report_s, size_mb, one, peak_mb)
                rows.append(size)
                print(
                    f"{trials:6d}  {mean_s:7.2f} s  {report_s:4.2f} s  {size_mb:4.1f} MB  {one:12d}  {peak_mb:8.0f} MB",
                    flush=True,
                )
                if plot is not None:
                    draw(rows, plot)
    vars(records)["read"] = read


def listed_s(root: Path, count: int) -> float:
    """Seconds of the processor to list `count` sessions of four trials."""
    with tempfile.TemporaryDirectory(dir=root.parent) as folder:
        small = Path(folder) / "small"
        shutil.copytree(root / "grows", small, ignore=shutil.ignore_patterns("iteration-*", "report.html", "log.*"))
        for number in (1, 2):
            if (root / f"grows/iteration-{number:02d}").is_dir():
                shutil.copytree(root / f"grows/iteration-{number:02d}", small / f"iteration-{number:02d}")
        for index in range(1, count):
            shutil.copytree(small, small.with_name(f"small-{index}"))
        spent_s, _ = cpu_s(lambda: [overview_or_damage(Path(folder), name) for name in names(Path(folder))])
    return spent_s


def film(folder: Path, count: int) -> str:
    """A film of `count` frames at the camera's size: time to compress and to read it, and its size."""
    model, rng = kinect_model(), np.random.default_rng(0)
    v, u = np.mgrid[: model.colour.height, : model.colour.width]
    smooth = np.stack([u // 6, v // 3, (u + v) // 9], axis=-1).astype(np.int16)
    noise = rng.integers(-6, 7, (*smooth.shape[:2], 1), np.int16)
    depth = rng.integers(695, 706, (model.depth.height, model.depth.width), np.uint16)
    colours = [np.clip(smooth + np.roll(noise, 7 * k, axis=0), 0, 255).astype(np.uint8) for k in range(4)]
    frames = (Frame(index / 30, colours[index % 4], np.roll(depth, index, axis=1)) for index in range(count))
    t_s = np.arange(round(count / 30 * 1000)) / 1000.0
    played = Execution(0.0, t_s, np.zeros((len(t_s), 7)), np.zeros((len(t_s), 7)), 1.0)

    def written() -> bytes:
        stored = [recording.stored(frame) for frame in frames]
        return recording.begin(stored[0], stored, model, np.eye(4), played, lambda _: np.eye(4)).finish(None)[0]

    path = folder / "film.mcap"
    written_s, content = cpu_s(written)
    path.write_bytes(content)
    read_s, _ = cpu_s(lambda: recording.read(path))
    return f"compressed in {written_s:.2f} s, read in {read_s:.2f} s, {len(content) / 1e6:.1f} MB"


def draw(sizes: Sequence[Size], path: Path) -> None:
    """The figure: time, memory and page against trials."""
    from matplotlib import pyplot as plt  # noqa: PLC0415 - only for the figure

    figure, axes = plt.subplots(1, 3, figsize=(9, 2.8), layout="constrained")
    trials = [size.trials for size in sizes]
    for axis, (title, unit, lines) in zip(
        axes,
        (
            ("time", "s of the processor", {"iteration": "iteration_s", "report": "report_s"}),
            ("memory at most", "MB", {"process": "peak_mb"}),
            ("page", "MB", {"report": "page_mb"}),
        ),
        strict=True,
    ):
        for label, name in lines.items():
            axis.plot(trials, [asdict(size)[name] for size in sizes], marker="o", label=label)
        axis.set(title=title, xlabel="trials", ylabel=unit, xlim=(0, None))
        axis.set_ylim(0, 1.1 * axis.get_ylim()[1])
        axis.legend(frameon=False)
        axis.spines[["top", "right"]].set_visible(False)
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    main()
