"""`docs/check_words.py`: it finds what it is for, leaves good sentences alone, and finds nothing in this project."""

from __future__ import annotations

import check_words as words
import pytest


@pytest.mark.long
def test_nothing_in_this_project_has_to_be_read_twice() -> None:
    assert not list(words.complaints())


@pytest.mark.parametrize(
    "text",
    [
        "DeviceUnavailable says what lacks",
        "goes before `height_m`",
        "friction is what is found out",
        "the lab starts afresh",
        "from what the object did both guesses are moved",
        "without what calibration found the camera's to be late by",
        "refused a touch that was none",
        "How unlike a trajectory is",
        "give the object whose ranges they are",
        "off by 2 mm, 19 times of 20",
        "X_FT is no pose",
        "look whether somebody pushed the arm",
        "views that took no part",
        "if it ended otherwise than tracking says",
        "the camera does not tell its temperature",
        "the recording lacks its camera.json",
    ],
)
def test_old_patterns_are_found(text: str) -> None:
    assert list(words.phrases(text))


@pytest.mark.parametrize(
    "text",
    [
        "a fault is cleared once the operator types `recover`",
        "overrides `height_m`",
        "What is a particle? A guess of the parameters.",
        "Guide the arm, let go, and press Enter.",
        "The tool whose edge touches the table is the spatula.",
        "This is what you see:",
        "There is no rig file.",
        "Look at the arm. Is it what you expected? Otherwise stop.",
    ],
)
def test_plain_english_passes(text: str) -> None:
    assert not list(words.phrases(text))


def test_a_long_sentence_is_found_in_cells_too_but_not_in_headings_or_code() -> None:
    long = " ".join(["word"] * (words.MOST_WORDS + 1))
    assert [why for _, why in words.long_sentences(f"Short.\n\n{long}.\n")] == [
        f'a sentence of {words.MOST_WORDS + 1} words: "{" ".join(["word"] * 6)} …"'
    ]
    half = " ".join(["word"] * (words.MOST_WORDS - 1))
    for found in (f"| {long} |", f"{half}; {half}.", f"{half}: {half}."):
        assert list(words.long_sentences(found))
    for fine in (f"| {half} | {half} |", f"* {half}\n* {half}", f"{half}. {half}.", f"# {long}"):
        assert not list(words.long_sentences(fine))
    assert not list(words.long_sentences(words.prose(f"```text\n{long}\n```\n")))


def test_docstrings_and_comments_are_read_but_not_names() -> None:
    source = '"""Afresh: `anew`."""\ntold = 1  # told\nname = f"begin {told} afresh"\n'
    assert sorted(words.texts(source)) == [(1, "Afresh: …."), (2, "told"), (3, "begin … afresh")]
