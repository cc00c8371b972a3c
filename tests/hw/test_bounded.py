"""Hostile files: generated ones and collected ones. Each is read or refused with one error, quickly."""

from __future__ import annotations

import json
import os
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hw import bounded
from hw.bounded import Unreadable, decode_image, parse_table, read_table

COLLECTED = {
    "deep arrays.toml": (b"a = " + b"[" * 100_000, "nested more than 32 deep"),
    "deep tables.toml": (b"a = " + b"{b = " * 50_000, "nested more than 32 deep"),
    "just too deep.toml": (b"a = " + b"[" * 33 + b"]" * 33, "nested more than 32 deep"),
    "long key.toml": (b"a" + b".a" * 200_000 + b" = 1", "more than 32 parts"),
    "long header.toml": (b"[a" + b".a" * 200_000 + b"]", "more than 32 parts"),
    "key in a table.toml": (b"x = {a" + b".a" * 100_000 + b" = 1}", "more than 32 parts"),
    "digits.toml": (b"a = " + b"9" * 5000, "thousands of digits"),
    "many bits.toml": (b"a = " + b"9" * 40, "more than 63 bits"),
    "infinite.toml": (b"a = inf", "not a finite number"),
    "nan.toml": (b"a = [1.0, nan]", "not a finite number"),
    "latin.toml": (b'a = "\xe4"', "not UTF-8"),
    "zeros.toml": (b"\0" * 1000, "not valid TOML"),
    "twice.toml": (b"a = 1\na = 2", "not valid TOML"),
    "utf-16.toml": ("a = 1".encode("utf-16"), "not UTF-8"),
    "large.toml": (b"#" * (bounded.TOML_BYTES + 1), "more than 4 MB"),
    "deep.json": (b"[" * 100_000, "nested more than 32 deep"),
    "deep objects.json": (b'{"a":' * 50_000, "nested more than 32 deep"),
    "nan.json": (b'{"a": NaN}', "not a finite number"),
    "infinite.json": (b'{"a": [1e999]}', "not a finite number"),
    "digits.json": (b'{"a": ' + b"9" * 5000 + b"}", "thousands of digits"),
    "list.json": (b"[]", "is not a table of keys and values"),
    "empty.json": (b"", "not valid JSON"),
    "comma.json": (b'{"a": 1,}', "not valid JSON"),
}


@pytest.mark.timeout(30)
@pytest.mark.parametrize("name", COLLECTED)
def test_a_hostile_file_is_refused_quickly(tmp_path: Path, name: str) -> None:
    content, message = COLLECTED[name]
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(Unreadable, match=message):
        read_table(path)


@settings(max_examples=150, deadline=None)
@given(st.binary(max_size=300), st.booleans())
def test_any_bytes_are_a_table_or_unreadable(content: bytes, is_toml: bool) -> None:
    try:
        assert isinstance(parse_table(content, is_toml=is_toml), dict)
    except Unreadable as error:
        assert str(error)


_JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=4), inner, max_size=4),
    max_leaves=12,
)


@settings(max_examples=150, deadline=None)
@given(_JSON)
def test_what_json_can_say_is_read_as_it_is_or_refused(value: object) -> None:
    try:
        data = parse_table(json.dumps(value).encode(), is_toml=False)
    except Unreadable:
        return
    assert data == value


def test_a_table_that_may_hold_nan() -> None:
    assert np.isnan(parse_table(b"a = nan", is_toml=True, finite=False)["a"])


def test_what_is_no_file_is_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.toml")
    for path, message in (
        (tmp_path / "pipe.toml", "not a file"),
        (Path("/dev/zero"), "not a file"),
        (tmp_path, "is a folder"),
    ):
        with pytest.raises(Unreadable, match=message):
            read_table(path)
    with pytest.raises(FileNotFoundError):
        read_table(tmp_path / "none.toml")


def image(suffix: str) -> bytes:
    return bytes(cv2.imencode(suffix, np.arange(48 * 64 * 3, dtype=np.uint8).reshape(48, 64, 3))[1])


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_an_image_is_decoded_as_opencv_does(suffix: str) -> None:
    content = image(suffix)
    expected = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR)
    assert (decode_image(content, cv2.IMREAD_COLOR) == expected).all()


def test_an_image_that_claims_to_be_huge_is_refused() -> None:
    content = bytearray(image(".png"))
    content[16:24] = (60_000).to_bytes(4, "big") * 2
    content[29:33] = zlib.crc32(content[12:29]).to_bytes(4, "big")
    with pytest.raises(Unreadable, match="60000 x 60000 pixels, too many"):
        decode_image(bytes(content), cv2.IMREAD_COLOR)


def test_a_chunk_that_claims_to_be_longer_than_the_file_is_not_given_room(monkeypatch) -> None:
    content = bytearray(image(".png"))
    content[33:37] = (2**31 - 1).to_bytes(4, "big")  # of the pixels' chunk, behind signature and header
    monkeypatch.setattr(cv2, "imdecode", lambda *_: pytest.fail("OpenCV would take 2 GB"))
    with pytest.raises(Unreadable, match="cut short or damaged"):
        decode_image(bytes(content), cv2.IMREAD_COLOR)


@pytest.mark.parametrize("content", [b"", b"\xff\xd8", b"BM" + b"\0" * 100, b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff" * 50])
def test_what_is_no_image_is_refused(content: bytes) -> None:
    with pytest.raises(Unreadable, match="PNG or"):
        decode_image(content, cv2.IMREAD_COLOR)


@settings(max_examples=100, deadline=None)
@given(st.sampled_from([".png", ".jpg"]), st.integers(0, 2000), st.binary(min_size=1, max_size=8))
def test_a_damaged_image_is_decoded_or_refused(suffix: str, at: int, other: bytes) -> None:
    content = bytearray(image(suffix))
    content[at % len(content) : at % len(content) + len(other)] = other
    try:
        assert decode_image(bytes(content), cv2.IMREAD_COLOR).ndim == 3
    except Unreadable as error:
        assert str(error)
