"""A session in the formats of other programs: tables, MCAP with everything, Rerun, LeRobot, scenes."""

from __future__ import annotations

import csv
import io
import sys
from collections.abc import Callable, Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Literal, get_args

from adaptsim_cli.errors import UsageError
from adaptsim_cli.session.records import Facts, TrialRecord
from adaptsim_cli.session.store import SessionStore, trials_of
from adaptsim_cli.storage import durable

Format = Literal["csv", "parquet", "mcap", "lerobot", "rerun", "sdf", "mjcf"]
FORMATS: tuple[Format, ...] = get_args(Format)
SCENES = {"sdf": "scene.sdf", "mjcf": "scene.xml"}
"""Formats of scenes, and the name of the file that a simulator loads."""
LAYOUT = "foxglove-layout.json"

Progress = Callable[[str, int, int], None]


Cell = str | int | float
Row = dict[str, Cell]


def export(
    store: SessionStore,
    kind: str,
    out: Path,
    scene_of: Callable[[SessionStore, str], Mapping[str, bytes]],
    progress: Progress = lambda stage, done, total: None,
) -> list[Path]:
    """Write the counting trials to `out`: a file for tables, else a folder. Returns the written paths.

    `scene_of` makes the files of a scene. Raises UsageError for an unknown format, for a session without trials, or if
    a data set or scene would overwrite something; ExtraMissing, SessionError, and the errors of `scene_of`.
    """
    if kind not in FORMATS:
        raise UsageError(f"--format {kind}: choose one of {', '.join(FORMATS)}")
    if not (records := trials_of(store)):
        raise UsageError(f"session {store.facts.name} has no completed trial yet; nothing to export")
    if kind == "csv":
        return [written(out, as_csv(rows(store)).encode())]
    if kind == "parquet":
        return [written(out, _parquet(store))]
    if kind == "lerobot":
        from adaptsim_cli.session import episodes

        episodes.write(store, records, out)
        return [out]
    if kind in SCENES:
        return _scene(out, kind, scene_of(store, kind))
    if store.facts.curves:
        raise UsageError(f"the task {store.facts.task} has no recordings: export it as csv, parquet or lerobot")
    from adaptsim_cli.session import replaying

    files, (suffix, encode) = [], ("rrd", replaying.rerun_file) if kind == "rerun" else ("mcap", replaying.encode)
    for done, record in enumerate(records):
        progress("trials", done + 1, len(records))
        trial = replaying.open_trial(store, record)
        files.append(written(out / f"{trial.title}.{suffix}", encode(trial)))
    if kind == "mcap":
        files.append(written(out / LAYOUT, layout()))
    return files


def _scene(folder: Path, kind: str, files: Mapping[str, bytes]) -> list[Path]:
    if folder.exists():
        raise UsageError(f"{folder} exists already: name another --out")
    durable.make_folder(folder.absolute().parent)
    durable.write_folder(folder.absolute(), files)
    return [folder / SCENES[kind], folder / "trial.json"]


def next_step(kind: str, first: Path, out: Path) -> tuple[str, str]:
    """The command that shows the export, and its effect."""
    python, table = sys.executable, f"import pyarrow.parquet as p; print(p.read_table('{out}'))"
    return {
        "csv": (f"column -s, -t {out} | less -S", "the table, in the terminal"),
        "parquet": (f'{python} -c "{table}"', "the table, read back"),
        "rerun": (f"{python} -m rerun {first}", "the first trial, in the Rerun viewer"),
        "lerobot": (f"ls -R {out}", "the data set, ready for lerobot"),
        "mcap": (f"xdg-open {first}", f"the first trial, in Foxglove, with the layout {out / LAYOUT}"),
        "sdf": (f"{python} -m pydrake.visualization.model_visualizer {first}", "the scene, in a browser"),
        "mjcf": (f"{python} -m mujoco.viewer --mjcf={first}", "the scene, in MuJoCo's viewer"),
    }[kind]


def layout() -> bytes:
    """The Foxglove layout for such a file."""
    return (resources.files("adaptsim_cli.session") / LAYOUT).read_bytes()


def default_name(store: SessionStore, kind: str) -> str:
    """The default name of an export, in the current folder."""
    return f"{store.facts.name}.{kind}" if kind in ("csv", "parquet") else f"{store.facts.name}-{kind}"


def _parquet(store: SessionStore) -> bytes:
    from adaptsim_cli.session.episodes import as_parquet

    table = rows(store)
    metadata = {f"unit of {name}": unit for name, unit in units(store).items()}
    return as_parquet({name: [row[name] for row in table] for name in table[0]}, metadata)


def written(path: Path, content: bytes) -> Path:
    """Write or replace one file, in a folder that may be new, and return its path."""
    durable.make_folder(path.absolute().parent)
    durable.replace_file(path.absolute(), content)
    return path


def rows(store: SessionStore) -> list[Row]:
    """One row for each trial that counts. Iterations, trials, attempts and particles are numbered from 1.

    A quantity's column is named `parameter_`, `context_` or `action_` plus its name; `units` gives its unit. Raises
    SessionError.
    """
    return [_row(store.facts, trial) for trial in trials_of(store)]


def units(store: SessionStore) -> dict[str, str]:
    """The unit of every column that has one. Rewards (0 to 1) have none."""
    facts = store.facts
    by_name = {
        f"{kind}_{d.name}": d.unit
        for kind, space in (("parameter", facts.parameters), ("context", facts.context), ("action", facts.action))
        for d in space
    }
    return {name: unit for name, unit in by_name.items() if unit} | {"duration_s": "s"}


def as_csv(table: Sequence[Mapping[str, Cell]]) -> str:
    """Rows as CSV, with the first row's columns and further ones of other rows."""
    text = io.StringIO()
    columns = dict.fromkeys(name for row in table for name in row)
    writer = csv.DictWriter(text, list(columns), lineterminator="\n", restval="")
    writer.writeheader()
    writer.writerows(table)
    return text.getvalue()


def _row(facts: Facts, trial: TrialRecord) -> Row:
    quantities = {"parameter": trial.parameters, "context": trial.context, "action": trial.action}
    return {
        **facts.named(),
        "started": trial.started,
        "iteration": trial.iteration,
        "trial": trial.trial,
        "attempt": trial.attempt,
        "particle": trial.particle,
        "outcome": trial.outcome.value,
        "overruled_from": trial.overruled_from.value if trial.overruled_from else "",
        "reward": trial.reward,
        "predicted_reward": trial.predicted_reward,
        "duration_s": trial.track.t_s[-1],
        **{f"{kind}_{name}": value for kind, point in quantities.items() for name, value in point.items()},
    }
