"""Hostile safetensors and Matroska files: damaged at many places, each is read or refused with one error."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from kinect_files import record
from kinect_recording import KinectRecording

from hw.bounded import TENSOR_HEADER_BYTES
from hw.errors import CameraError
from sim.errors import CheckpointError
from sim.storage.files import load_tensors, save_tensors


def tensors_of(header: bytes, data: bytes = b"", claimed: int | None = None) -> bytes:
    return struct.pack("<Q", len(header) if claimed is None else claimed) + header + data


def entry(shape: list[int], offsets: list[object]) -> dict[str, object]:
    return {"dtype": "F32", "shape": shape, "data_offsets": offsets}


TENSORS = {
    "empty": b"",
    "seven bytes": b"\0" * 7,
    "huge header": tensors_of(b"{}", claimed=2**63),
    "header beyond the file": tensors_of(b"{}", claimed=100),
    "header of megabytes": tensors_of(b" " * (TENSOR_HEADER_BYTES + 1)),
    "deep header": tensors_of(b'{"a":' * 5000),
    "no table": tensors_of(b"[]"),
    "latin": tensors_of(b'{"\xe4": 1}'),
    "no offsets": tensors_of(json.dumps({"a": {"dtype": "F32", "shape": [1]}}).encode(), bytes(4)),
    "offsets of text": tensors_of(json.dumps({"a": entry([1], ["0", "4"])}).encode(), bytes(4)),
    "claims terabytes": tensors_of(json.dumps({"a": entry([2**40], [0, 2**42])}).encode(), bytes(4)),
    "shape and size differ": tensors_of(json.dumps({"a": entry([9], [0, 4])}).encode(), bytes(4)),
    "shape overflows": tensors_of(json.dumps({"a": entry([2**62, 2**62], [0, 4])}).encode(), bytes(4)),
    "negative offset": tensors_of(json.dumps({"a": entry([1], [-4, 4])}).encode(), bytes(4)),
    "unknown kind": tensors_of(json.dumps({"a": entry([1], [0, 4]) | {"dtype": "Q"}}).encode(), bytes(4)),
    "data left over": tensors_of(json.dumps({"a": entry([1], [0, 4])}).encode(), bytes(400)),
    "a pickle": b"\x80\x04\x95" + bytes(100),
    "a zip": b"PK\x03\x04" + bytes(100),
}


def refused(path: Path, read: Callable[[Path], object], tries: int, *, cut_every: int, most_bits: int) -> int:
    """How often a file that is cut short or has flipped bits is refused; else it is read."""
    whole, rng, count = path.read_bytes(), np.random.default_rng(0), 0
    for number in range(tries):
        content = bytearray(whole)
        if number % cut_every == 0:
            del content[int(rng.integers(len(content))) :]
        else:
            for _ in range(int(rng.integers(1, most_bits + 1))):
                content[int(rng.integers(len(content)))] ^= 1 << int(rng.integers(8))
        path.write_bytes(bytes(content))
        try:
            read(path)
        except (CheckpointError, CameraError):
            count += 1
    return count


@pytest.mark.timeout(60)
@pytest.mark.parametrize("name", TENSORS)
def test_hostile_tensors_end_in_an_error_that_names_the_file(tmp_path: Path, name: str) -> None:
    path = tmp_path / "policy.safetensors"
    path.write_bytes(TENSORS[name])
    with pytest.raises(CheckpointError, match=r"policy\.safetensors.*make it again"):
        load_tensors(path)


@pytest.mark.timeout(120)
def test_tensors_cut_short_or_damaged_are_read_or_refused(tmp_path: Path) -> None:
    path = tmp_path / "policy.safetensors"
    save_tensors(path, {"a": np.arange(6.0).reshape(2, 3), "b": np.ones(4, dtype=np.int64)})
    assert refused(path, load_tensors, 150, cut_every=3, most_bits=1) >= 100


MATROSKA = {
    "empty": b"",
    "zeros": b"\0" * 5000,
    "a playlist": b"#EXTM3U\n#EXTINF:1,\nfile:///etc/passwd\n#EXT-X-ENDLIST\n",
    "a list of files": b"ffconcat version 1.0\nfile '/etc/passwd'\n",
    "head alone": b"\x1aE\xdf\xa3" + b"\x01" + b"\xff" * 7,
    "html": b"<!doctype html><title>Sign in</title>",
}


def read_all(path: Path) -> None:
    """Every frame of a recording."""
    with KinectRecording(path) as recording:
        for _ in recording.frames():
            pass


@pytest.mark.timeout(60)
@pytest.mark.parametrize("name", MATROSKA)
def test_hostile_recordings_end_in_an_error_that_names_the_file(tmp_path: Path, name: str) -> None:
    path = tmp_path / "film.mkv"
    path.write_bytes(MATROSKA[name])
    with pytest.raises(CameraError, match=r"film\.mkv"):
        read_all(path)


def test_a_folder_and_a_pipe_are_no_recording(tmp_path: Path) -> None:
    with pytest.raises(CameraError, match="folder"):
        KinectRecording(tmp_path).__enter__()
    with pytest.raises(CameraError, match="not a"):
        KinectRecording(Path("/dev/zero")).__enter__()


@pytest.mark.timeout(240)
def test_recordings_cut_short_or_damaged_are_read_or_refused(tmp_path: Path) -> None:
    path = tmp_path / "film.mkv"
    times_s = [i / 30 for i in range(4)]
    record(path, times_s, times_s)
    assert refused(path, read_all, 120, cut_every=4, most_bits=19) >= 20
