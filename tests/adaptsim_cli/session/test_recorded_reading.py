"""Recorded trials from the files of others: tables, and MCAP written by the ROS 2 writer of the mcap packages."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from documents import ROOT
from mcap.writer import Writer as McapWriter
from mcap_ros2.writer import Writer
from recordings import JOINTS, MANIFEST, recordings, write_mcap, write_tables

from adaptsim_cli.session.recorded.folder import digest, read_recorded
from hw.types import Array
from sim.errors import RecordingsRefused
from sim.tasks import get_task
from sim.tasks.pendulum import TASK

ARRAY = (
    "MultiArrayLayout layout\nfloat64[] data\n" + "=" * 80 + "\nMSG: std_msgs/MultiArrayLayout\n"
    "MultiArrayDimension[] dim\nuint32 data_offset\n" + "=" * 80 + "\nMSG: std_msgs/MultiArrayDimension\n"
    "string label\nuint32 size\nuint32 stride\n"
)
POSE = (
    "std_msgs/Header header\ngeometry_msgs/Pose pose\n" + "=" * 80 + "\nMSG: geometry_msgs/Pose\n"
    "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n" + "=" * 80 + "\nMSG: geometry_msgs/Point\n"
    "float64 x\nfloat64 y\nfloat64 z\n" + "=" * 80 + "\nMSG: geometry_msgs/Quaternion\n"
    "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n" + JOINTS[JOINTS.index("=") :]
)


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
        ({"trajectories_csv": HEAD + "run0,0,a,0,0,0,0\n"}, "line 2: q1 = 'a' is not a number"),
        (
            {"trajectories_csv": HEAD + "".join(f"run{i},0,nan,0,0,0,0\n" for i in range(8))},
            "run0: state has values that are not finite",
        ),
        ({"trajectories_csv": HEAD + "other,0,0,0,0,0,0\n"}, "trial run0 has no sample"),
        ({"manifest": 'task = "toss"\n[tables]\nstate = ["q1"]\n'}, "is of task toss, not of pendulum"),
        ({"manifest": 'task = "pendulum"\n'}, "name one source: tables, mcap, lerobot, robomimic or sessions"),
        ({"manifest": 'task = "pendulum"\n[tables]\nstates = ["q1"]\n'}, "tables.state: field required"),
        ({"manifest": "task = "}, "is not valid TOML"),
        ({"manifest": 'task = "pendulum"\nsessions = ["gone"]\n'}, "gone is not a session"),
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


PUSHING = get_task("pushing")
PUSHES = """task = "pushing"
outcome = "upright"
[tables]
state = ["x", "y", "z"]
"""


def pushes(folder: Path, change: Callable[[Array, Array, int], tuple[Array, Array]] = lambda t, s, i: (t, s)) -> Path:
    """Ten slides of the bottle from its mark; `change` spoils times (N,) and states (N, 3) of trial i."""
    rng, folder_ = np.random.default_rng(3), folder
    folder_.mkdir()
    (folder_ / "recorded.toml").write_text(PUSHES)
    rows, samples = ["trial,yaw,speed"], ["trial,t_s,x,y,z"]
    for i in range(10):
        action = PUSHING.action.sample(rng, 1)[0]
        rows.append(f"p{i},{action[0]!r},{action[1]!r}".replace("np.float64(", "").replace(")", ""))
        t_s = np.arange(0.0, 1.5, 1 / 30)
        far = 0.3 * (1 - np.exp(-3 * t_s)) * (1 + i / 10)
        t_s, state = change(t_s, np.stack([0.56 + far, 0.02 * i * far, np.full(len(t_s), 0.05)], axis=1), i)
        samples += [f"p{i},{t:.9g}," + ",".join(f"{v:.6g}" for v in row) for t, row in zip(t_s, state, strict=True)]
    (folder_ / "trials.csv").write_text("\n".join(rows))
    (folder_ / "trajectories.csv").write_text("\n".join(samples))
    return folder_


def jump(t: Array, s: Array, i: int) -> tuple[Array, Array]:
    return (np.where((t > 0.5) & (i == 4), t + 3600.0, t), s)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t, s, i: (t, 1e3 * s), "trial p0: column 1 of its state is 7"),
        (lambda t, s, i: (1e3 * t, s), "there is no sample for 33.33 s"),
        (lambda t, s, i: (t + 1.7e9, s), "its first sample is at 1.7e+09 s"),
        (lambda t, s, i: (t, s[:, [1, 0, 2]]), "trial p0: at time 0 the object lies at (0.000, +0.560) m"),
        (lambda t, s, i: (t, np.c_[t, s[:, 1:]]), "at time 0 the object lies at (0.000, +0.000) m, 560 mm from"),
        (lambda t, s, i: (t, np.tile([0.56, 0.0, 0.05], (len(t), 1))), "all 10 trajectories are alike"),
        (jump, "trial p4: after 0.5 s there is no sample for 3600 s"),
        (lambda t, s, i: (t, s + np.array([0.06, 0.0, 0.0])), "begins 60 mm aside of its place, by (+60, +0) mm"),
        (lambda t, s, i: (t, s + np.array([0.0, -0.09, 0.0])), "begins 90 mm aside of its place, by (+0, -90) mm"),
        (lambda t, s, i: (t[:12], s[:12]), "it ends at 0.3667 s while the object moves"),
    ],
    ids=["mm", "ms", "unix", "swapped", "time as x", "still", "jump", "ahead", "right", "short"],
)
def test_other_units_clocks_and_columns_are_refused_by_what_they_are(tmp_path, change, message):
    with pytest.raises(RecordingsRefused) as refused:
        read_recorded(PUSHING, pushes(tmp_path / "lab", change))
    assert message in str(refused.value)


def test_pushes_in_the_units_of_the_task_are_read_also_after_blank_lines_and_spaces(tmp_path):
    folder = pushes(tmp_path / "lab")
    plain = digest(read_recorded(PUSHING, folder))
    for name in ("trials.csv", "trajectories.csv"):
        spaced = (folder / name).read_text().replace(",", ", ")
        (folder / name).write_text(spaced + "\n\n  \n")
    assert digest(read_recorded(PUSHING, folder)) == plain


def test_semicolons_and_decimal_commas_are_named(tmp_path):
    folder = pushes(tmp_path / "lab")
    whole = (folder / "trials.csv").read_text()
    (folder / "trials.csv").write_text(whole.replace(",", ";").replace(".", ","))
    with pytest.raises(RecordingsRefused, match=r"separates its columns by semicolons.*1\.5, not 1,5"):
        read_recorded(PUSHING, folder)
    (folder / "trials.csv").write_text(whole)
    text = (folder / "trajectories.csv").read_text().replace("p3,0,0.56", 'p3,0,"0,56"')
    (folder / "trajectories.csv").write_text(text)
    with pytest.raises(RecordingsRefused, match="with a point, not a comma"):
        read_recorded(PUSHING, folder)


@pytest.mark.parametrize("files", ["/etc/*", "", "**a/*.mcap", "a\0b"])
def test_a_pattern_that_names_no_files_of_the_folder_is_refused(tmp_path, files):
    folder = write_mcap(tmp_path / "mcap", 8)
    (folder / "recorded.toml").write_text(MANIFEST.replace("[mcap]\n", f"[mcap]\nfiles = {json.dumps(files)}\n"))
    with pytest.raises(RecordingsRefused):
        read_recorded(TASK, folder)


def test_an_index_of_five_thousand_digits_is_refused(tmp_path):
    folder = write_mcap(tmp_path / "mcap", 8)
    (folder / "recorded.toml").write_text(MANIFEST.replace("position[0]", f"position[{'9' * 5000}]"))
    with pytest.raises(RecordingsRefused, match="no field 'position"):
        read_recorded(TASK, folder)


def test_names_with_a_nul_are_refused(tmp_path):
    for manifest in ('trials = "a\\u0000b"\nstate = ["x", "y", "z"]', ""):
        folder = pushes(tmp_path / f"lab{bool(manifest)}")
        text = f'task = "pushing"\noutcome = "upright"\n[tables]\n{manifest}\n'
        (folder / "recorded.toml").write_text(text if manifest else 'task = "pushing"\nsessions = ["a\\u0000b"]\n')
        with pytest.raises(RecordingsRefused):
            read_recorded(PUSHING, folder)


def test_files_that_macos_writes_beside_others_are_skipped(tmp_path):
    folder = write_mcap(tmp_path / "mcap", 8)
    (folder / "._swing-00.mcap").write_bytes(b"\0\5\x16\7")
    assert len(read_recorded(TASK, folder)) == 8


def test_a_truncated_mcap_file_is_refused_with_a_reason(tmp_path):
    folder = write_mcap(tmp_path / "mcap", 8)
    whole = (folder / "swing-03.mcap").read_bytes()
    for length in (3, 9, 40, len(whole) // 2, len(whole) - 5):
        (folder / "swing-03.mcap").write_bytes(whole[:length])
        with pytest.raises(RecordingsRefused) as refused:
            read_recorded(TASK, folder)
        assert not str(refused.value).rstrip().endswith(":")


def test_a_bad_message_definition_is_named(tmp_path):
    folder = write_mcap(tmp_path / "mcap", 8)
    for path in folder.glob("*.mcap"):
        path.unlink()
    for i in range(8):
        with (folder / f"swing-{i}.mcap").open("wb") as file:
            writer = McapWriter(file)
            writer.start("ros2")
            schema = writer.register_schema("lab_msgs/msg/Joints", "ros2msg", b"float64[ position\n@@@ nonsense 7")
            channel = writer.register_channel("/joints", "cdr", schema)
            writer.add_message(channel, 0, b"\0\1\0\0" + bytes(64), 0)
            writer.finish()
    with pytest.raises(RecordingsRefused, match=r"swing-0\.mcap"):
        read_recorded(TASK, folder)


def test_no_flipped_bit_of_a_recorded_file_changes_a_number_in_silence(tmp_path):
    """Of 120 bits, without checksums 39 gave other numbers."""
    folder, rng = write_mcap(tmp_path / "mcap", 8), np.random.default_rng(0)
    whole, plain = (folder / "swing-03.mcap").read_bytes(), digest(read_recorded(TASK, folder))
    refused = 0
    for _ in range(40):
        damaged = bytearray(whole)
        damaged[int(rng.integers(len(whole)))] ^= 1 << int(rng.integers(8))
        (folder / "swing-03.mcap").write_bytes(bytes(damaged))
        try:
            assert digest(read_recorded(TASK, folder)) == plain
        except RecordingsRefused:
            refused += 1
    assert refused > 20


def test_the_example_of_the_page_reads_the_standard_message(tmp_path):
    """`std_msgs/Float64MultiArray` has no header: times are those of the log."""
    page = (ROOT / "docs/guide/recorded-trials.md").read_text()
    (manifest,) = (block for block in re.findall(r"```toml\n(.*?)```", page, re.S) if "[mcap]" in block)
    folder = tmp_path / "lab"
    folder.mkdir()
    (folder / "recorded.toml").write_text(manifest)
    rng = np.random.default_rng(0)
    for i in range(8):
        with (folder / f"push-{i}.mcap").open("wb") as file:
            writer = Writer(file)
            command = writer.register_msgdef("std_msgs/msg/Float64MultiArray", ARRAY)
            bottle = writer.register_msgdef("geometry_msgs/msg/PoseStamped", POSE)
            writer.write_message(
                "/command",
                command,
                {"layout": {"dim": [], "data_offset": 0}, "data": PUSHING.action.sample(rng, 1)[0].tolist()},
                50 * 10**9,
            )
            for t_s in np.arange(0.0, 1.5, 0.05):
                place = {"x": 0.56 + 0.2 * (1 - np.exp(-3 * t_s)) * (1 + i / 9), "y": 0.0, "z": 0.05}
                head = {"stamp": {"sec": 7, "nanosec": 0}, "frame_id": "base"}
                pose = {"position": place, "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}}
                writer.write_message("/bottle", bottle, {"header": head, "pose": pose}, round(1e9 * (50.04 + t_s)))
            writer.finish()
    trials = read_recorded(PUSHING, folder)
    assert len(trials) == 8
    assert trials.tracks[0].t_s[0] == pytest.approx(0.0, abs=1e-6)


def with_twin(folder: Path, columns: str) -> Path:
    """Pushes whose speed is commanded in one column and measured in another, and this mapping of columns."""

    def change(name: str, text: str) -> str:
        if name == "recorded.toml":
            return text + f"[tables.columns]\n{columns}"
        head, *lines = text.splitlines()
        if name != "trials.csv":
            return text
        at = head.split(",").index("speed")
        measured = [f"{line},{0.9 * float(line.split(',')[at])!r}" for line in lines]
        return "\n".join([f"{head.replace('speed', 'flange_speed')},speed", *measured]) + "\n"

    pushes(folder)
    for name in ("recorded.toml", "trials.csv"):
        (folder / name).write_text(change(name, (folder / name).read_text()))
    return folder


def test_a_mapped_column_wins_over_one_of_the_name_and_the_other_is_named(tmp_path):
    plain = read_recorded(PUSHING, pushes(tmp_path / "plain"))
    mapped = read_recorded(PUSHING, with_twin(tmp_path / "mapped", 'speed = "flange_speed"\n'))
    assert digest(mapped) == digest(plain)
    assert plain.notes == ()
    assert mapped.notes == ("the column 'speed' of trials.csv is not used, because speed is read from 'flange_speed'",)
    swapped = with_twin(tmp_path / "swapped", 'speed = "flange_speed"\nflange_speed = "speed"\n')
    assert read_recorded(PUSHING, swapped).notes == ()
    assert digest(read_recorded(PUSHING, swapped)) == digest(plain)


def test_two_names_of_one_column_are_refused(tmp_path):
    folder = with_twin(tmp_path / "twice", 'speed = "flange_speed"\nyaw = "flange_speed"\n')
    with pytest.raises(RecordingsRefused, match="columns reads speed and yaw from 'flange_speed'"):
        read_recorded(PUSHING, folder)
    manifest = folder / "recorded.toml"
    manifest.write_text(manifest.read_text().partition("[tables.columns]")[0].replace('"y"', '"x"'))
    with pytest.raises(RecordingsRefused, match="state names the column 'x' twice"):
        read_recorded(PUSHING, folder)
