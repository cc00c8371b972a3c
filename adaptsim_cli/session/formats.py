"""A session in the formats of other programs: tables, MCAP with everything, Rerun, LeRobot, scenes. Each is a row.

Cheap to import, because the command names its formats in its help.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

from adaptsim_cli.errors import UsageError

if TYPE_CHECKING:
    from adaptsim_cli.session.records import TrialRecord
    from adaptsim_cli.session.store import SessionStore
    from sim.rollouts.run import StageProgress

LAYOUT = "foxglove-layout.json"

SceneOf = Callable[["SessionStore", str], Mapping[str, bytes]]
"""Makes the files of a scene, by the name of its format."""


@dataclass(frozen=True)
class Export:
    """One export: a session with trials, and where to."""

    store: SessionStore
    records: Sequence[TrialRecord]
    out: Path
    scene_of: SceneOf
    progress: StageProgress

    def recordings(self, suffix: str, encode: Callable[[Any], bytes]) -> list[Path]:
        """A file for each trial with its recording. Raises UsageError for a session without recordings."""
        from adaptsim_cli.session import replaying
        from adaptsim_cli.session.exporting import written

        paths = list[Path]()
        for number, record in enumerate(self.records, start=1):
            self.progress("trials", number, len(self.records))
            try:
                trial = replaying.open_trial(self.store, record)
            except UsageError as error:
                error.add_note(f"Export it as {', '.join(WITHOUT_RECORDINGS)}.")
                raise
            paths.append(written(self.out / f"{trial.title}.{suffix}", encode(trial)))
        return paths

    def scene(self, kind: str, file: str) -> list[Path]:
        """The folder of a scene; a simulator loads `file`. Raises UsageError if the folder exists."""
        return self.folder(kind, (file, "trial.json"))

    def folder(self, kind: str, files: Sequence[str]) -> list[Path]:
        """Write the folder of a format, and return the paths of these files in it. Raises UsageError if the folder
        exists.
        """
        from adaptsim_cli.storage import durable

        if self.out.exists():
            raise UsageError(f"{self.out} exists already: name another --out")
        durable.make_folder(self.out.absolute().parent)
        durable.write_folder(self.out.absolute(), self.scene_of(self.store, kind))
        return [self.out / file for file in files]


@dataclass(frozen=True)
class ExportFormat:
    """Everything about one format; a row of `FORMATS`."""

    suffix: str  # of the default name: .csv for a file, -mcap for a folder
    write: Callable[[Export], list[Path]]  # returns the written paths
    next_step: Callable[[Path, Path], tuple[str, str]]
    """(first written path, `out`) -> the command that shows the export, and its effect."""


def _csv(request: Export) -> list[Path]:
    from adaptsim_cli.session.exporting import as_csv, rows, written

    return [written(request.out, as_csv(rows(request.store)).encode())]


def _parquet(request: Export) -> list[Path]:
    from adaptsim_cli.session.episodes import as_parquet
    from adaptsim_cli.session.exporting import rows, units, written

    table = rows(request.store)
    metadata = {f"unit of {name}": unit for name, unit in units(request.store).items()}
    return [written(request.out, as_parquet({name: [row[name] for row in table] for name in table[0]}, metadata))]


def _mcap(request: Export) -> list[Path]:
    from adaptsim_cli.session import replaying
    from adaptsim_cli.session.exporting import written

    return [*request.recordings("mcap", replaying.encode), written(request.out / LAYOUT, layout())]


def _motion(request: Export) -> list[Path]:
    from adaptsim_cli.session import motion_table

    return request.recordings("csv", motion_table.as_table)


def _rerun(request: Export) -> list[Path]:
    from adaptsim_cli.session import replaying

    return request.recordings("rrd", replaying.rerun_file)


def _lerobot(request: Export) -> list[Path]:
    from adaptsim_cli.session import episodes

    episodes.write(request.store, request.records, request.out)
    return [request.out]


_PYTHON = sys.executable

FORMATS: dict[str, ExportFormat] = {
    "csv": ExportFormat(
        ".csv", _csv, lambda first, out: (f"column -s, -t {out} | less -S", "the table, in the terminal")
    ),
    "parquet": ExportFormat(
        ".parquet",
        _parquet,
        lambda first, out: (
            f"{_PYTHON} -c \"import pyarrow.parquet as p; print(p.read_table('{out}'))\"",
            "the table, read back",
        ),
    ),
    "mcap": ExportFormat(
        "-mcap",
        _mcap,
        lambda first, out: (f"xdg-open {first}", f"the first trial, in Foxglove, with the layout {out / LAYOUT}"),
    ),
    "lerobot": ExportFormat(
        "-lerobot", _lerobot, lambda first, out: (f"ls -R {out}", "the data set, ready for lerobot")
    ),
    "rerun": ExportFormat(
        "-rerun", _rerun, lambda first, out: (f"{_PYTHON} -m rerun {first}", "the first trial, in the Rerun viewer")
    ),
    "sdf": ExportFormat(
        "-sdf",
        lambda request: request.scene("sdf", "scene.sdf"),
        lambda first, out: (f"{_PYTHON} -m pydrake.visualization.model_visualizer {first}", "the scene, in a browser"),
    ),
    "ranges": ExportFormat(
        "-ranges",
        lambda request: request.folder("ranges", ("ranges.json", "ranges.toml")),
        lambda first, out: (
            (f"{_PYTHON} {out / 'drake_ranges.py'}", "draws one sample, as contact properties of Drake")
            if (out / "drake_ranges.py").exists()
            else (f"{_PYTHON} -m json.tool {out / 'ranges.json'} | less", "the ranges, with a thousand joint samples")
        ),
    ),
    "mjcf": ExportFormat(
        "-mjcf",
        lambda request: request.scene("mjcf", "scene.xml"),
        lambda first, out: (f"{_PYTHON} -m mujoco.viewer --mjcf={first}", "the scene, in MuJoCo's viewer"),
    ),
    "motion": ExportFormat(
        "-motion",
        _motion,
        lambda first, out: (f"column -s, -t {first} | less -S", "the first motion's joints, torques and forces"),
    ),
}
"""Every format by its name: the option, its completion, the default name and the next step derive from here."""

WITHOUT_RECORDINGS = ("csv", "parquet", "lerobot", "ranges")
"""The formats for a task without recordings."""


def format_named(kind: str) -> ExportFormat:
    """Raises UsageError naming the formats there are."""
    if kind not in FORMATS:
        raise UsageError(f"--format {kind}: choose one of {', '.join(FORMATS)}")
    return FORMATS[kind]


def export(
    store: SessionStore,
    kind: str,
    out: Path,
    scene_of: SceneOf,
    progress: StageProgress = lambda stage, done, total: None,
) -> list[Path]:
    """Write the counting trials to `out`: a file for tables, else a folder. Returns the written paths.

    Raises UsageError for an unknown format, for a session without trials, or if a data set or scene would overwrite
    something; ExtraMissing, SessionError, and the errors of `scene_of`.
    """
    chosen = format_named(kind)
    from adaptsim_cli.session.history import played_of

    if not (records := played_of(store)):
        raise UsageError(f"session {store.facts.name} has no completed trial yet; nothing to export")
    return chosen.write(Export(store, records, out, scene_of, progress))


def layout() -> bytes:
    """The Foxglove layout for such a file."""
    return (resources.files("adaptsim_cli.session") / LAYOUT).read_bytes()


def default_name(store: SessionStore, kind: str) -> str:
    """The default name of an export, in the current folder. Raises UsageError for an unknown format."""
    return f"{store.facts.name}{format_named(kind).suffix}"
