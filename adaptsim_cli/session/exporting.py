"""A session in the formats of other programs: tables, MCAP with everything, Rerun, LeRobot."""

from __future__ import annotations

import sys
from collections.abc import Callable
from importlib import resources
from pathlib import Path
from typing import Literal, get_args

from adaptsim_cli.errors import UsageError
from adaptsim_cli.session.store import SessionStore, as_csv, rows, trials_of, units
from adaptsim_cli.storage import durable

Format = Literal["csv", "parquet", "mcap", "lerobot", "rerun"]
FORMATS: tuple[Format, ...] = get_args(Format)
LAYOUT = "foxglove-layout.json"

Progress = Callable[[str, int, int], None]


def export(
    store: SessionStore, kind: str, out: Path, progress: Progress = lambda stage, done, total: None
) -> list[Path]:
    """Write the counting trials to `out`: a file for tables, else a folder. Returns the written paths.

    Raises UsageError for an unknown format, for a session without trials, or if a data set would overwrite something;
    ExtraMissing, SessionError.
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

        episodes.write(store, out)
        return [out]
    if store.facts.curves:
        raise UsageError(f"the task {store.facts.task} has no recordings: export it as csv, parquet or lerobot")
    from adaptsim_cli.session import replaying, whole

    made = []
    for done, record in enumerate(records):
        if progress is not None:
            progress("trials", done + 1, len(records))
        trial = whole.open_trial(store, record)
        if kind == "rerun":
            made.append(written(out / f"{trial.title}.rrd", replaying.rerun_file(trial)))
        else:
            made.append(written(out / f"{trial.title}.mcap", whole.encode(trial)))
    if kind == "mcap":
        made.append(written(out / LAYOUT, layout()))
    return made


def next_step(kind: str, first: Path, out: Path) -> tuple[str, str]:
    """The command that shows the export, and its effect."""
    if kind == "csv":
        return f"column -s, -t {out} | less -S", "the table, in the terminal"
    if kind == "parquet":
        return (
            f"{sys.executable} -c \"import pyarrow.parquet as p; print(p.read_table('{out}'))\"",
            "the table, read back",
        )
    if kind == "rerun":
        return f"{sys.executable} -m rerun {first}", "the first trial, in the Rerun viewer"
    if kind == "lerobot":
        return f"ls -R {out}", "the data set, ready for lerobot"
    return f"xdg-open {first}", f"the first trial, in Foxglove, with the layout {out / LAYOUT}"


def layout() -> bytes:
    """The Foxglove layout for such a file."""
    return (resources.files("adaptsim_cli.session") / LAYOUT).read_bytes()


def default_name(store: SessionStore, kind: str) -> str:
    """The default name of an export, in the current folder."""
    return f"{store.facts.name}.{kind}" if kind in ("csv", "parquet") else f"{store.facts.name}-{kind}"


def _parquet(store: SessionStore) -> bytes:
    from adaptsim_cli.session.episodes import as_parquet

    table = rows(store)
    told = {f"unit of {name}": unit for name, unit in units(store).items()}
    return as_parquet({name: [row[name] for row in table] for name in table[0]}, told)


def written(path: Path, content: bytes) -> Path:
    """Write or replace one file, in a folder that may be new, and return its path."""
    durable.make_folder(path.absolute().parent)
    durable.replace_file(path.absolute(), content)
    return path
