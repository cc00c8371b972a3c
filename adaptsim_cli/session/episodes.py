"""Completed trials as a LeRobot data set (v2.1): one episode per trial, with the recorded images.

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
from adaptsim_cli.session import whole
from adaptsim_cli.session.records import TrialRecord
from adaptsim_cli.session.store import SessionStore, trials_of
from adaptsim_cli.storage import durable

VERSION = "v2.1"
CAMERA_FPS, SIMULATED_FPS = 30, 50
IMAGE = "observation.images.camera"
_CHUNK = 1000


@dataclass(frozen=True, eq=False)
class Episode:
    """One trial, frame by frame."""

    record: TrialRecord
    task: str
    state: NDArray[np.float32]  # (N, s)
    action: NDArray[np.float32]  # (N, a)
    t_s: NDArray[np.float32]  # (N,) since the start of the motion
    images: tuple[bytes, ...]  # JPEG; empty without a camera
    size: tuple[int, int]  # (height, width) of an image


def write(store: SessionStore, folder: Path) -> int:
    """Write the data set of a session into a new `folder`; returns how many episodes it has.

    Raises UsageError if the folder exists or the session has no trial, ExtraMissing without pyarrow, SessionError.
    """
    if folder.exists():
        raise UsageError(f"{folder} exists already: name another --out")
    records = trials_of(store)
    if not records:
        raise UsageError(f"session {store.facts.name} has no completed trial yet; nothing to export")
    has_camera = not store.facts.curves and (whole_folder(store, records[0]) / "recording.mcap").exists()
    fps = CAMERA_FPS if has_camera else SIMULATED_FPS
    index, episodes, statistics = 0, [], []
    names: Mapping[str, list[str]] = {}
    shape: tuple[int, int] = (0, 0)
    for number, record in enumerate(records):
        episode = _seen(store, record) if has_camera else _simulated(store, record)
        table, stats = _table(episode, number, index, fps)
        durable.make_folder(folder / "data" / f"chunk-{number // _CHUNK:03d}")
        durable.write_file(folder / _data(number), table)
        index, shape = index + len(episode.state), episode.size
        names = _names(store, episode, has_camera=has_camera)
        episodes.append({"episode_index": number, "tasks": [episode.task], "length": len(episode.state)})
        statistics.append({"episode_index": number, "stats": stats})
    durable.make_folder(folder / "meta")
    info = _info(store, len(records), index, fps, names, shape)
    durable.write_file(folder / "meta/info.json", (json.dumps(info, indent=4) + "\n").encode())
    tasks = [{"task_index": 0, "task": store.facts.title}]
    for name, lines in (("tasks", tasks), ("episodes", episodes), ("episodes_stats", statistics)):
        text = "".join(json.dumps(line, allow_nan=False) + "\n" for line in lines)
        durable.write_file(folder / f"meta/{name}.jsonl", text.encode())
    return len(records)


def whole_folder(store: SessionStore, record: TrialRecord) -> Path:
    """The folder of a trial."""

    return store.trial_folder(*record.place)


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
        raise ExtraMissing("Parquet needs pyarrow: pip install 'adaptsim[export]'") from error
    return pa, pq


def _seen(store: SessionStore, record: TrialRecord) -> Episode:
    """The episode of a recording: joints at every image."""
    trial = whole.open_trial(store, record)
    played, pictures = trial.stored.execution, whole.jpegs(trial)
    times_s = np.array([t_s for t_s, _ in pictures]) - played.t_start_s
    state, action = (
        np.stack([np.interp(times_s, played.t_s, joint) for joint in joints.T], axis=1).astype(np.float32)
        for joints in (played.q_measured_rad, played.q_commanded_rad)
    )
    colour = trial.stored.model.colour
    images, size = tuple(jpeg for _, jpeg in pictures), (colour.height, colour.width)
    return Episode(record, store.facts.title, state, action, times_s.astype(np.float32), images, size)


def _simulated(store: SessionStore, record: TrialRecord) -> Episode:
    """The episode of a trajectory: the state at even times; the action is that of the whole trial."""
    track = record.track.track()
    times_s = np.arange(0.0, float(track.t_s[-1]) + 1e-9, 1.0 / SIMULATED_FPS)
    action = np.tile(record.action_array.astype(np.float32), (len(times_s), 1))
    state = track.at(times_s).astype(np.float32)
    return Episode(record, store.facts.title, state, action, times_s.astype(np.float32), (), (0, 0))


def _table(e: Episode, number: int, first: int, fps: int) -> tuple[bytes, dict[str, Any]]:
    """The frames of an episode as Parquet, and their statistics."""
    pa, _ = _arrow()
    n = len(e.state)
    done = np.arange(n) == n - 1
    scalars = {
        "next.reward": np.where(done, e.record.reward, 0.0).astype(np.float32),
        "next.done": done,
        "arm_time_s": e.t_s,
        "timestamp": (np.arange(n) / fps).astype(np.float32),
        "frame_index": np.arange(n),
        "episode_index": np.full(n, number),
        "index": np.arange(first, first + n),
        "task_index": np.zeros(n, np.int64),
    }
    vectors = {"observation.state": e.state, "action": e.action}
    columns: dict[str, Any] = {
        name: pa.FixedSizeListArray.from_arrays(pa.array(values.ravel()), values.shape[1])
        for name, values in vectors.items()
    }
    columns |= {name: pa.array(values) for name, values in scalars.items()}
    stats = {name: _statistics(values) for name, values in {**vectors, **scalars}.items()}
    if e.images:
        kind = pa.struct([("bytes", pa.binary()), ("path", pa.string())])
        columns[IMAGE] = pa.array([{"bytes": jpeg, "path": None} for jpeg in e.images], kind)
        stats[IMAGE] = _image_statistics(e.images)
    kinds: dict[str, Any] = {name: _value(str(np.asarray(values).dtype)) for name, values in scalars.items()}
    kinds |= {
        name: {"feature": _value("float32"), "length": values.shape[1], "_type": "Sequence"}
        for name, values in vectors.items()
    }
    kinds |= {IMAGE: {"_type": "Image"}} if e.images else {}
    features = {name: kinds[name] for name in columns}
    return as_parquet(columns, {"huggingface": json.dumps({"info": {"features": features}})}), stats


def _value(dtype: str) -> dict[str, str]:
    return {"dtype": dtype, "_type": "Value"}


def _statistics(values: NDArray[Any]) -> dict[str, Any]:
    rows = values.reshape(len(values), -1).astype(np.float64)
    found = {"min": rows.min(axis=0), "max": rows.max(axis=0), "mean": rows.mean(axis=0), "std": rows.std(axis=0)}
    return {**{name: row.tolist() for name, row in found.items()}, "count": [len(values)]}


def _image_statistics(images: Sequence[bytes]) -> dict[str, Any]:
    """Statistics of each colour over some of the images, from 0 to 1, in LeRobot's form."""
    import cv2

    from hw.bounded import decode_image

    chosen = images[:: max(1, len(images) // 8)]
    decoded = (np.asarray(decode_image(jpeg, cv2.IMREAD_COLOR), np.uint8) for jpeg in chosen)
    pixels = np.concatenate([picture[::8, ::8, ::-1].reshape(-1, 3).astype(np.float64) / 255.0 for picture in decoded])
    found = _statistics(pixels)
    colours = {name: np.reshape(values, (3, 1, 1)).tolist() for name, values in found.items() if name != "count"}
    return {**colours, "count": [len(chosen)]}


def _names(store: SessionStore, e: Episode, *, has_camera: bool) -> Mapping[str, list[str]]:
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
        "total_videos": 0,
        "total_chunks": (episodes + _CHUNK - 1) // _CHUNK,
        "chunks_size": _CHUNK,
        "fps": fps,
        "splits": {"train": f"0:{episodes}"},
        "data_path": "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet",
        "video_path": None,
        "features": features,
    }


def _data(number: int) -> str:
    return f"data/chunk-{number // _CHUNK:03d}/episode_{number:06d}.parquet"
