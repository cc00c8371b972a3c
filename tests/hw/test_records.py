"""Records outlive a version: additions of a newer one are kept, named, and never an error; a typing error is."""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from hw.records import HandWritten, Record, content_of, from_any_version


class Inner(Record):
    value_m: float = 0.0


class Outer(Record):
    rows: tuple[Inner, ...] = ()
    by_name: dict[str, Inner] = {}  # noqa: RUF012 - pydantic copies it
    centre: Inner | None = None


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
