"""Exported trials, read by the programs that they are for: `make test-extra`."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from toy_session import run

from adaptsim_cli.session import episodes, exporting, formats, replaying
from adaptsim_cli.session.best_scene import scene_files
from adaptsim_cli.session.exporting import rows
from adaptsim_cli.session.history import trials_of
from adaptsim_cli.session.store import SessionStore

pytestmark = pytest.mark.extra

READ_BY_LEROBOT = """
import json, sys
import torch
try:
    import torchvision
except RuntimeError:  # its compiled part needs CUDA where torch is the CPU's; LeRobot imports it and calls none of it
    for name in ("nms", "qnms"):
        torch.library.define(f"torchvision::{name}", "(Tensor dets, Tensor scores, float iou_threshold) -> Tensor")
from lerobot.datasets.lerobot_dataset import LeRobotDataset
data = LeRobotDataset("local/session", root=sys.argv[1])
last = data[len(data) - 1]
print(json.dumps({
    "frames": len(data), "episodes": data.num_episodes, "fps": data.fps,
    "shapes": {name: list(value.shape) for name, value in last.items() if hasattr(value, "shape")},
    "least": data.meta.stats["action"]["min"].tolist(),
    "reward": float(last["next.reward"]), "done": bool(last["next.done"]), "task": last["task"],
}))
"""


@pytest.fixture(scope="module")
def store(tmp_path_factory) -> SessionStore:
    return run(tmp_path_factory.mktemp("exports"))


def chunks(file: Path) -> Iterator[Any]:
    from rerun.chunk import RrdReader  # noqa: PLC0415 - collected without the extra too

    yield from RrdReader(str(file)).stream()


def components(file: Path, entity: str) -> set[str]:
    """What an entity has, as archetype:field."""
    return {
        name
        for chunk in chunks(file)
        if str(chunk.entity_path) == entity
        for name in chunk.to_record_batch().schema.names
    }


def values(file: Path, entity: str, component: str) -> list[Any]:
    """All values of one component of an entity."""
    batches = [chunk.to_record_batch() for chunk in chunks(file) if str(chunk.entity_path) == entity]
    return [row for b in batches if component in b.schema.names for row in b.column(component).to_pylist() if row]


def test_in_rerun_depth_is_depth_and_the_arm_moves(store, tmp_path):
    trial = replaying.open_trial(store, store.trials(0)[0])
    played = trial.stored.execution  # the toy's arm rests: here it turns about its base
    turned = played.q_measured_rad + np.outer(np.linspace(0.0, 0.5, len(played.t_s)), np.eye(7)[0])
    moving = replace(trial, stored=replace(trial.stored, execution=replace(played, q_measured_rad=turned)))
    file = exporting.written(tmp_path / "moving.rrd", replaying.rerun_file(moving))
    depth = "/base/camera/depth_camera/image"
    assert "DepthImage:buffer" in components(file, depth)
    assert {meter for row in values(file, depth, "DepthImage:meter") for meter in row} == {1000.0}
    places = np.array([row[0] for row in values(file, "/base/panda_hand", "Transform3D:translation")])
    assert np.ptp(places, axis=0).max() > 0.05
    assert np.ptp(np.linalg.norm(places[:, :2], axis=1)) < 1e-4
    assert "Mesh3D:vertex_positions" in components(file, "/base/panda_hand/shape-34")
    assert any("outcome" in row[0] for row in values(file, "/events", "TextLog:text"))


def test_rerun_reads_the_mcap_file_itself(store, tmp_path):
    file, *_ = formats.export(store, "mcap", tmp_path, scene_files)
    out = tmp_path / "converted.rrd"
    subprocess.run([sys.executable, "-m", "rerun", "mcap", "convert", str(file), "-o", str(out)], check=True)
    assert "DepthImage:buffer" in components(out, "/camera/depth")
    assert "EncodedImage:blob" in components(out, "/camera/colour")


def test_a_parquet_table_has_names_units_and_every_trial(store, tmp_path):
    import pyarrow.parquet as pq  # noqa: PLC0415 - collected without the extra too

    (file,) = formats.export(store, "parquet", tmp_path / "t.parquet", scene_files)
    found = pq.read_table(file)
    assert found.to_pylist() == rows(store)
    assert found.schema.metadata[b"unit of duration_s"] == b"s"


def test_lerobot_loads_the_data_set(store, tmp_path):
    trials = trials_of(store)
    episodes.write(store, trials, tmp_path / "set")
    env = {**os.environ, "HF_HUB_OFFLINE": "1", "HF_HOME": str(tmp_path / "hf")}
    if "LEROBOT" in os.environ:
        env["PYTHONPATH"] = os.environ["LEROBOT"]
    program = [os.environ.get("LEROBOT_PYTHON", sys.executable), "-c", READ_BY_LEROBOT, str(tmp_path / "set")]
    said = subprocess.run(program, env=env, capture_output=True, text=True, check=False)
    assert said.returncode == 0, said.stderr[-2000:]
    found = json.loads(said.stdout.splitlines()[-1])
    assert found["episodes"] == len(trials)
    assert found["fps"] == episodes.CAMERA_FPS
    assert found["shapes"]["observation.state"] == found["shapes"]["action"] == [7]
    assert found["shapes"][episodes.IMAGE][0] == 3
    assert len(found["least"]) == 7
    assert found["reward"] == pytest.approx(trials[-1].reward)
    assert found["done"]
    assert found["task"] == store.facts.title
