"""Recorded trials from the files of others: tables, and MCAP written by the ROS 2 writer of the mcap packages."""

from __future__ import annotations

import numpy as np
import pytest
from recordings import MANIFEST, recordings, write_mcap, write_tables

from adaptsim_cli.wiring.recorded.folder import digest, read_recorded
from sim.errors import RecordingsRefused
from sim.tasks.pendulum import TASK


def test_trials_that_a_foreign_ros_2_writer_recorded_are_read_with_their_clock_corrected(tmp_path):
    found = read_recorded(TASK, write_mcap(tmp_path / "mcap", 9))
    actions, tracks = recordings(9)
    assert found.names[0] == "swing-00"
    assert np.array_equal(found.actions, actions)
    for seen, track in zip(found.tracks, tracks, strict=True):
        assert seen.outcome is track.outcome
        assert seen.t_s == pytest.approx(track.t_s, abs=1e-6)
        assert np.array_equal(seen.state, track.state)


def test_the_same_trials_from_tables_have_the_same_values_and_free_columns_do_not_matter(tmp_path):
    found = read_recorded(TASK, write_tables(tmp_path / "tables", 9))
    actions, tracks = recordings(9)
    assert np.array_equal(found.actions, actions)
    assert np.array_equal(found.tracks[4].state, tracks[4].state)
    rows = (tmp_path / "tables/trials.csv").read_text().replace("Ada", "Grace")
    assert digest(found) == digest(read_recorded(TASK, write_tables(tmp_path / "other", 9, trials_csv=rows)))
    assert digest(found) != digest(read_recorded(TASK, write_tables(tmp_path / "fewer", 8)))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"position[1]"', '"position[7]"', "no field 'position[7]'"),
        ('"/joints"', '"/arm"', "no message of topic /arm; its topics are /chatter, /command, /joints, /verdict"),
        ('"header"\n', '"clock"\n', "mcap.clock"),
        ('"/verdict:data"', '"/verdict"', "write topic:field"),
        ('"/verdict:data"', '"/chatter:data"', "outcome 'hello' is not known"),
        ("[mcap]\n", '[mcap]\nfiles = "*.bag"\n', "is called *.bag"),
        ("late_s = 0.04", "late_s = 3.0", "its times must increase"),
    ],
)
def test_a_wrong_name_in_the_manifest_of_mcap_files_is_named(tmp_path, old, new, message):
    folder = write_mcap(tmp_path / "mcap", 8)
    assert old in MANIFEST
    (folder / "recorded.toml").write_text(MANIFEST.replace(old, new))
    with pytest.raises(RecordingsRefused) as refused:
        read_recorded(TASK, folder)
    assert message in str(refused.value)


def test_a_damaged_mcap_file_is_refused(tmp_path):
    folder = write_mcap(tmp_path / "mcap", 8)
    whole = (folder / "swing-03.mcap").read_bytes()
    for content in (whole[: len(whole) // 2], b"", whole[:300] + bytes(100) + whole[400:]):
        (folder / "swing-03.mcap").write_bytes(content)
        with pytest.raises(RecordingsRefused, match=r"swing-03\.mcap"):
            read_recorded(TASK, folder)


HEAD = "trial,t_s,q1,q2,v1,v2,excess\n"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"trials_csv": ""}, "trials.csv is empty"),
        ({"trials_csv": "trial,trial\n"}, "names a column twice"),
        ({"trials_csv": "trial,outcome\nrun0,settled\n"}, "has samples of trial run1, which is not listed"),
        ({"trials_csv": "trial,outcome\n" + "".join(f"run{i},settled\n" for i in range(8))}, "run0: k11 is missing"),
        (
            {
                "trials_csv": f"trial,outcome,{','.join(TASK.action.names)}\n"
                + "".join(f"run{i},settled{',nan' * 8}\n" for i in range(8))
            },
            "run0: k11 = nan",
        ),
        ({"trials_csv": "trial,outcome\nrun0\n"}, "line 2: 1 cells instead of 2"),
        ({"trajectories_csv": "trial,t_s,q1\n"}, "has no column 'q2'"),
        ({"trajectories_csv": HEAD + "run0,0,a,0,0,0,0\n"}, "line 2: q1 = 'a' is no number"),
        (
            {"trajectories_csv": HEAD + "".join(f"run{i},0,nan,0,0,0,0\n" for i in range(8))},
            "run0: state has values that are not finite",
        ),
        ({"trajectories_csv": HEAD + "other,0,0,0,0,0,0\n"}, "trial run0 has no sample"),
        ({"manifest": 'task = "toss"\n[tables]\nstate = ["q1"]\n'}, "is of task toss, not of pendulum"),
        ({"manifest": 'task = "pendulum"\n'}, "name one source: tables, mcap or sessions"),
        ({"manifest": 'task = "pendulum"\n[tables]\nstates = ["q1"]\n'}, "tables.state: field required"),
        ({"manifest": "task = "}, "is not valid TOML"),
        ({"manifest": 'task = "pendulum"\nsessions = ["gone"]\n'}, "gone is no session"),
        ({"manifest": 'task = "pendulum"\n[tables]\nstate = ["q1"]\n'}, "needs 2 columns, and has 1"),
        (
            {"manifest": 'task = "pendulum"\n[tables]\nstate = ["q1","q2"]\ncolumns = {outcome = "end"}\n'},
            "has no column 'end'",
        ),
        ({"manifest": 'task = "pendulum"\noutcome = "won"\n[tables]\nstate = ["q1"]\n'}, "outcome: it must be"),
    ],
)
def test_tables_that_cannot_serve_are_refused_with_the_place(tmp_path, changes, message):
    with pytest.raises(RecordingsRefused) as refused:
        read_recorded(TASK, write_tables(tmp_path / "lab", 8, **changes))
    assert message in str(refused.value)


def test_a_folder_without_a_manifest_names_the_page_that_explains_it(tmp_path):
    with pytest.raises(RecordingsRefused, match=r"recorded\.toml is missing.*recorded-trials\.md"):
        read_recorded(TASK, tmp_path)
    with pytest.raises(RecordingsRefused, match="there is no such folder"):
        read_recorded(TASK, tmp_path / "gone")
