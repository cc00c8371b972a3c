"""Records outlive a version: additions of a newer one are kept, named, and never an error; a typing error is."""

from __future__ import annotations

from enum import StrEnum

import pytest
from pydantic import ValidationError

from hw.records import HandWritten, Record, content_of, from_any_version, number_hint
from sim.adaptation.verdict import Kind, Verdict


class Inner(Record):
    value_m: float = 0.0


class Outer(Record):
    rows: tuple[Inner, ...] = ()
    by_name: dict[str, Inner] = {}  # noqa: RUF012 - pydantic copies it
    centre: Inner | None = None


class Word(StrEnum):
    OLD = "old"
    UNKNOWN = "unknown"


class Closed(StrEnum):
    LEFT = "left"


class Spoken(Record):
    word: Word = Word.OLD
    side: Closed = Closed.LEFT


class Typed(HandWritten):
    mass_kg: float


NEWER = {
    "rows": [{"value_m": 1.0, "sigma_m": 0.1}, {"value_m": 2.0}],
    "by_name": {"edge": {"value_m": 3.0, "place": "left"}},
    "centre": {"value_m": 0.5, "axis": [0.0, 0.0, 1.0]},
    "context_off": True,
}


def test_additions_are_ignored_named_and_written_back():
    record = from_any_version(Outer, NEWER)
    assert record.model_dump() == {
        "rows": ({"value_m": 1.0}, {"value_m": 2.0}),
        "by_name": {"edge": {"value_m": 3.0}},
        "centre": {"value_m": 0.5},
    }
    assert record.additions == ("context_off", "rows.sigma_m", "by_name.place", "centre.axis")
    assert content_of(record) == NEWER
    assert content_of(record.model_copy(update={"centre": None}))["context_off"] is True


def test_a_new_word_is_read_as_unknown_named_and_written_back():
    record = from_any_version(Spoken, {"word": "newest", "side": "left"})
    assert record.word is Word.UNKNOWN
    assert record.additions == ("word",)
    assert content_of(record) == {"word": "newest", "side": "left"}
    assert from_any_version(Spoken, {"word": "old"}).additions == ()
    with pytest.raises(ValidationError, match="side"):
        from_any_version(Spoken, {"side": "right"})
    with pytest.raises(ValidationError, match="word"):
        Spoken.model_validate({"word": "newest"})


def test_the_verdict_of_a_newer_version_is_no_damage():
    stored = {"kind": "scattered", "reward": 0.5, "ci95": [0.2, 0.8], "trials": 8, "strange": 0}
    verdict = from_any_version(Verdict, stored)
    assert verdict.kind is Kind.UNKNOWN
    assert not verdict.stops
    assert content_of(verdict)["kind"] == "scattered"


def test_a_record_without_additions_has_none():
    assert Outer().additions == ()
    assert content_of(Outer()) == {"rows": [], "by_name": {}, "centre": None}


@pytest.mark.parametrize("table", [{"context_off": True}, {"rows": [{"value_m": 1.0, "sigma_m": 0.1}]}])
def test_an_unknown_key_is_an_error_where_no_file_of_another_version_is_read(table):
    with pytest.raises(ValidationError, match="extra"):
        Outer.model_validate(table)


@pytest.mark.parametrize("table", [{"rows": [{"value_m": "one"}]}, {"rows": 3}, {"centre": {"value_m": float("nan")}}])
def test_every_other_defect_stays_an_error(table):
    with pytest.raises(ValidationError):
        from_any_version(Outer, table | {"context_off": True})


def test_a_number_in_quotes_is_an_error_in_a_file_of_a_person():
    assert Typed.model_validate({"mass_kg": 1}).mass_kg == 1.0
    with pytest.raises(ValidationError, match="valid number"):
        Typed.model_validate({"mass_kg": "1"})


@pytest.mark.parametrize(
    ("value", "hint"),
    [
        ("0,94", ": write 0.94 instead of '0,94', with a point, not a comma, and without quotes"),
        (" 1.5 ", ": write 1.5 instead of ' 1.5 ', without quotes"),
        ("1,234,5", ""),
        ("far", ""),
        (None, ""),
        (0.94, ""),
    ],
)
def test_a_number_that_is_given_as_a_text_is_named_as_it_should_be_written(value, hint):
    assert number_hint(value) == hint
