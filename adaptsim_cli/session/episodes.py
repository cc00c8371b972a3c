"""Completed trials as a LeRobot data set (v3.0): one episode and one file per trial, with the recorded images.

Format: https://huggingface.co/docs/lerobot; read by `lerobot.datasets.lerobot_dataset.LeRobotDataset(repo_id, root)`.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from adaptsim_cli.errors import UsageError
from adaptsim_cli.session import replaying
from adaptsim_cli.session.records import TrialRecord
from adaptsim_cli.session.store import SessionStore
from adaptsim_cli.storage import durable
from hw.extras import missing

VERSION = "v3.0"
CAMERA_FPS, SIMULATED_FPS = 30, 50
IMAGE = "observation.images.camera"
_CHUNK = 1000


@dataclass(frozen=True, eq=False)
class Frames:
    """The frames of one trial: an episode."""

    state: NDArray[np.float32]  # (N, s)
    action: NDArray[np.float32]  # (N, a)
    t_s: NDArray[np.float32]  # (N,) since the start of the motion
    images: tuple[bytes, ...]  # JPEG; empty without a camera
    size: tuple[int, int]  # (height, width) of an image


def write(store: SessionStore, records: Sequence[TrialRecord], folder: Path) -> None:
    """Write the data set of a session's trials, at least one, into a new `folder`.

    Raises UsageError if the folder exists, ExtraMissing without pyarrow, SessionError.
    """
    if folder.exists():
        raise UsageError(f"{folder} exists already: name another --out")
    has_camera = not store.facts.curves and (store.trial_folder(*records[0].position) / "recording.mcap").exists()
    fps = CAMERA_FPS if has_camera else SIMULATED_FPS
    index, columns = 0, list[dict[str, Any]]()
    names: Mapping[str, list[str]] = {}
    shape: tuple[int, int] = (0, 0)
    for number, record in enumerate(records):
        episode = _seen(store, record) if has_camera else _simulated(store, record)
        values = _values(record.reward, episode, number, index, fps)
        _write_table(folder / _file("data", number), values, episode.images)
        columns.append(values | ({IMAGE: _pixels(episode.images)} if episode.images else {}))
        index, shape = index + len(episode.state), episode.size
        names = _names(store, episode, has_camera=has_camera)
    info = _info(store, len(records), index, fps, names, shape)
    durable.make_folder(folder / "meta")
    durable.write_file(folder / "meta/tasks.parquet", _tasks(store.facts.title))
    durable.make_folder((folder / _file("meta/episodes", 0)).parent)
    durable.write_file(folder / _file("meta/episodes", 0), as_parquet(_episodes(store.facts.title, columns)))
    whole_set = {name: _statistics(np.concatenate([one[name] for one in columns]), name) for name in columns[0]}
    for name, content in (("stats", whole_set), ("info", info)):
        durable.write_file(folder / f"meta/{name}.json", (json.dumps(content, indent=4) + "\n").encode())


def as_parquet(columns: Mapping[str, Any], metadata: Mapping[str, str] | None = None) -> bytes:
    """A table of columns as a Parquet file. Raises ExtraMissing without pyarrow."""
    import io

    pa, pq = _arrow()
    table = pa.table(dict(columns))
    if metadata:
        table = table.replace_schema_metadata({**(table.schema.metadata or {}), **metadata})
    stream = io.BytesIO()
    pq.write_table(table, stream)
    return stream.getvalue()


def _arrow() -> tuple[Any, Any]:
    from sim.errors import ExtraMissing

    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError as error:
        raise ExtraMissing(missing("Parquet", "pyarrow", "export")) from error
    return pa, pq


def _seen(store: SessionStore, record: TrialRecord) -> Frames:
    """The episode of a recording: joints at every image."""
    trial = replaying.open_trial(store, record)
    played, pictures = trial.stored.execution, replaying.jpegs(trial)
    times_s = np.array([t_s for t_s, _ in pictures]) - played.t_start_s
    state, action = (
        np.stack([np.interp(times_s, played.t_s, joint) for joint in joints.T], axis=1).astype(np.float32)
        for joints in (played.q_measured_rad, played.q_commanded_rad)
    )
    colour = trial.stored.model.colour
    images, size = tuple(jpeg for _, jpeg in pictures), (colour.height, colour.width)
    return Frames(state, action, times_s.astype(np.float32), images, size)


def _simulated(store: SessionStore, record: TrialRecord) -> Frames:
    """The episode of a trajectory. It has the state at even times, and the same action, that of the trial, at each of
    them.
    """
    track = record.track.track()
    times_s = np.arange(0.0, float(track.t_s[-1]) + 1e-9, 1.0 / SIMULATED_FPS)
    action = np.tile(record.action_array.astype(np.float32), (len(times_s), 1))
    state = track.at(times_s).astype(np.float32)
    return Frames(state, action, times_s.astype(np.float32), (), (0, 0))


def _values(reward: float, e: Frames, number: int, first: int, fps: int) -> dict[str, NDArray[Any]]:
    """The frames of an episode, column by column."""
    n = len(e.state)
    done = np.arange(n) == n - 1
    return {
        "observation.state": e.state,
        "action": e.action,
        "next.reward": np.where(done, reward, 0.0).astype(np.float32),
        "next.done": done,
        "arm_time_s": e.t_s,
        "timestamp": (np.arange(n) / fps).astype(np.float32),
        "frame_index": np.arange(n),
        "episode_index": np.full(n, number),
        "index": np.arange(first, first + n),
        "task_index": np.zeros(n, np.int64),
    }


def _write_table(path: Path, values: Mapping[str, NDArray[Any]], images: Sequence[bytes]) -> None:
    """The frames of an episode as Parquet, with the types by which `datasets` reads them."""
    pa, _ = _arrow()
    columns, features = dict[str, Any](), dict[str, Any]()
    for name, column in values.items():
        of_one = {"dtype": str(column.dtype), "_type": "Value"}
        if column.ndim == 1:
            columns[name], features[name] = pa.array(column), of_one
        else:
            columns[name] = pa.FixedSizeListArray.from_arrays(pa.array(column.ravel()), column.shape[1])
            features[name] = {"feature": of_one, "length": column.shape[1], "_type": "List"}
    if images:
        kind = pa.struct([("bytes", pa.binary()), ("path", pa.string())])
        columns[IMAGE] = pa.array([{"bytes": jpeg, "path": None} for jpeg in images], kind)
        features[IMAGE] = {"_type": "Image"}
    durable.make_folder(path.parent)
    durable.write_file(path, as_parquet(columns, {"huggingface": json.dumps({"info": {"features": features}})}))


def _tasks(title: str) -> bytes:
    """The one task, as the index of a pandas table."""
    fields = (("task_index", "task_index", "int64"), ("__index_level_0__", None, "unicode"))
    columns = [
        {"name": name, "field_name": field, "pandas_type": kind, "numpy_type": "int64" if name else "object"}
        for field, name, kind in fields
    ]
    about = {"index_columns": [fields[1][0]], "column_indexes": [], "columns": columns, "pandas_version": "2.2"}
    return as_parquet({"task_index": [0], fields[1][0]: [title]}, {"pandas": json.dumps(about)})


def _episodes(title: str, columns: Sequence[Mapping[str, NDArray[Any]]]) -> dict[str, list[Any]]:
    """The table of the episodes: the place of each in the data, and its statistics."""
    numbers = range(len(columns))
    ends = [int(values["index"][-1]) + 1 for values in columns]
    table: dict[str, list[Any]] = {
        "episode_index": list(numbers),
        "data/chunk_index": [number // _CHUNK for number in numbers],
        "data/file_index": [number % _CHUNK for number in numbers],
        "dataset_from_index": [0, *ends[:-1]],
        "dataset_to_index": ends,
        "tasks": [[title] for _ in numbers],
        "length": [len(values["index"]) for values in columns],
        "meta/episodes/chunk_index": [0 for _ in numbers],
        "meta/episodes/file_index": [0 for _ in numbers],
    }
    for name in columns[0]:
        statistics = [_statistics(values[name], name) for values in columns]
        table |= {f"stats/{name}/{kind}": [one[kind] for one in statistics] for kind in statistics[0]}
    return table


def _statistics(values: NDArray[Any], name: str) -> dict[str, Any]:
    """The statistics of a column in LeRobot's form; those of an image are (3, 1, 1), from 0 to 1."""
    table = values.reshape(len(values), -1).astype(np.float64)
    extremes = {
        "min": table.min(axis=0),
        "max": table.max(axis=0),
        "mean": table.mean(axis=0),
        "std": table.std(axis=0),
    }
    shape = (3, 1, 1) if name == IMAGE else (-1,)
    return {kind: value.reshape(shape).tolist() for kind, value in extremes.items()} | {"count": [len(values)]}


def _pixels(images: Sequence[bytes]) -> NDArray[np.float64]:
    """(N, 3) some pixels of some of the images, for statistics."""
    import cv2

    from hw.bounded import decode_image

    chosen = images[:: max(1, len(images) // 8)]
    decoded = (np.asarray(decode_image(jpeg, cv2.IMREAD_COLOR), np.uint8) for jpeg in chosen)
    return np.concatenate([picture[::8, ::8, ::-1].reshape(-1, 3).astype(np.float64) / 255.0 for picture in decoded])


def _names(store: SessionStore, e: Frames, *, has_camera: bool) -> Mapping[str, list[str]]:
    if has_camera:
        joints = [f"panda_joint{i}" for i in range(1, 8)]
        return {"observation.state": joints, "action": joints}
    curves = {column: name for name, column in store.facts.curves.items()}
    state = [curves.get(i, f"state_{i}") for i in range(e.state.shape[1])]
    return {"observation.state": state, "action": [d.name for d in store.facts.action]}


def _info(
    store: SessionStore, episodes: int, frames: int, fps: int, names: Mapping[str, list[str]], size: tuple[int, int]
) -> dict[str, Any]:
    kinds = {"next.reward": "float32", "next.done": "bool", "arm_time_s": "float32", "timestamp": "float32"}
    kinds |= dict.fromkeys(("frame_index", "episode_index", "index", "task_index"), "int64")
    features: dict[str, Any] = {
        name: {"dtype": "float32", "shape": [len(words)], "names": words} for name, words in names.items()
    }
    if size[0]:
        features[IMAGE] = {"dtype": "image", "shape": [*size, 3], "names": ["height", "width", "channels"]}
    features |= {name: {"dtype": kind, "shape": [1], "names": None} for name, kind in kinds.items()}
    return {
        "codebase_version": VERSION,
        "robot_type": store.facts.hw if store.facts.hw != "fake" else "simulated panda",
        "total_episodes": episodes,
        "total_frames": frames,
        "total_tasks": 1,
        "chunks_size": _CHUNK,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": fps,
        "splits": {"train": f"0:{episodes}"},
        "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "video_path": None,
        "features": features,
    }


def _file(kind: str, number: int) -> str:
    return f"{kind}/chunk-{number // _CHUNK:03d}/file-{number % _CHUNK:03d}.parquet"
