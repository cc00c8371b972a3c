"""Recorded trials from Parquet, written by pyarrow itself: `make test-extra`."""

from __future__ import annotations

from pathlib import Path

import pytest
from recordings import write_tables

from adaptsim_cli import api
from adaptsim_cli.commands import app
from adaptsim_cli.session.recorded.folder import digest, read_recorded
from sim.errors import RecordingsRefused
from sim.tasks.pendulum import TASK

pytestmark = pytest.mark.extra

PARQUET = """
task = "pendulum"

[tables]
trials = "trials.parquet"
trajectories = "trajectories.parquet"
state = ["q1", "q2", "v1", "v2", "excess"]
"""


def write_parquet(folder: Path) -> Path:
    from pyarrow import csv, parquet  # noqa: PLC0415 - collected without the extra too

    write_tables(folder, 24, PARQUET)
    for path in folder.glob("*.csv"):
        parquet.write_table(csv.read_csv(path), path.with_suffix(".parquet"))
        path.unlink()
    return folder


def test_a_session_on_parquet_has_the_trials_of_the_same_tables_in_csv_and_ends_with_a_verdict(tmp_path, monkeypatch):
    monkeypatch.setenv("ADAPTSIM_HOME", str(tmp_path))
    folder = write_parquet(tmp_path / "parquet")
    assert digest(read_recorded(TASK, folder)) == digest(read_recorded(TASK, write_tables(tmp_path / "csv", 24)))
    asked = ["run-iteration", "--task", "pendulum", "--recorded", str(folder), "--session", "p", "--yes"]
    assert app.run([*asked, "-n", "2"]) == 0
    assert api.open_session("p").iterations[-1].verdict.trials == 4


def test_a_damaged_parquet_file_and_an_empty_cell_are_refused(tmp_path):
    from pyarrow import csv, parquet  # noqa: PLC0415

    folder = write_parquet(tmp_path / "parquet")
    whole = (folder / "trajectories.parquet").read_bytes()
    for content in (b"", whole[: len(whole) // 2], whole[:400] + bytes(200) + whole[600:]):
        (folder / "trajectories.parquet").write_bytes(content)
        with pytest.raises(RecordingsRefused, match=r"trajectories\.parquet"):
            read_recorded(TASK, folder)
    lines = (write_tables(tmp_path / "csv", 24) / "trajectories.csv").read_text().splitlines()
    lines[3] = ",".join([*lines[3].split(",")[:2], "", *lines[3].split(",")[3:]])
    (tmp_path / "holes.csv").write_text("\n".join(lines))
    parquet.write_table(csv.read_csv(tmp_path / "holes.csv"), folder / "trajectories.parquet")
    with pytest.raises(RecordingsRefused, match="line 4: q1 = None is not a number"):
        read_recorded(TASK, folder)


def test_a_small_file_of_very_many_rows_is_refused_before_it_is_decoded(tmp_path):
    """1.3 MB held 60 million rows, which did not end in 300 s."""
    import pyarrow  # noqa: PLC0415
    from pyarrow import parquet  # noqa: PLC0415

    folder = write_parquet(tmp_path / "parquet")
    rows = 3_000_000
    columns = {name: pyarrow.repeat(0.0, rows) for name in ("t_s", "q1", "q2", "v1", "v2", "excess")}
    table = pyarrow.table({"trial": pyarrow.repeat("run0", rows), **columns})
    parquet.write_table(table, folder / "trajectories.parquet")
    assert (folder / "trajectories.parquet").stat().st_size < 2e6
    with pytest.raises(RecordingsRefused, match=r"has 3000000 rows.* at most 2000000 rows"):
        read_recorded(TASK, folder)


def test_only_the_needed_columns_are_read_and_capitals_in_a_suffix_do_not_matter(tmp_path):
    import pyarrow  # noqa: PLC0415
    from pyarrow import parquet  # noqa: PLC0415

    folder = write_parquet(tmp_path / "parquet")
    plain = digest(read_recorded(TASK, folder))
    table = parquet.read_table(folder / "trajectories.parquet")
    wide = table.append_column("pictures", pyarrow.array([b"x" * 100] * len(table)))
    parquet.write_table(wide, folder / "T.PARQUET")
    (folder / "recorded.toml").write_text(PARQUET.replace("trajectories.parquet", "T.PARQUET"))
    assert digest(read_recorded(TASK, folder)) == plain


def test_a_column_that_is_there_twice_is_named(tmp_path):
    from pyarrow import parquet  # noqa: PLC0415

    folder = write_parquet(tmp_path / "parquet")
    for name in ("trials", "trajectories"):
        table = parquet.read_table(folder / f"{name}.parquet")
        parquet.write_table(
            table.append_column("k11" if name == "trials" else "q1", table.column(1)), folder / f"{name}.parquet"
        )
        with pytest.raises(RecordingsRefused, match=rf"{name}\.parquet names a column twice: "):
            read_recorded(TASK, folder)
        parquet.write_table(table, folder / f"{name}.parquet")
