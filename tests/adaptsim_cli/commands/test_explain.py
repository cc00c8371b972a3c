"""A message that somebody saw is explained from the source that raises it."""

from __future__ import annotations

import pytest

from adaptsim_cli.commands import app
from adaptsim_cli.screen import exit_codes, messages


def explained(text: str, capsys: pytest.CaptureFixture[str]) -> tuple[int, str]:
    code = app.run(["explain", text])
    shown = capsys.readouterr()
    return code, " ".join((shown.out + shown.err).split())


@pytest.mark.parametrize(
    ("seen", "kind", "next_step"),
    [
        ("no frame within 1 s; check the camera's cable and power, then redo the trial", "CameraError", "Check camera"),
        ("none of the 64 best actions for context [0.9 0.1] lies within the limits", "NotExecutable", "preview"),
        ("the sealed holds no row", "", ""),
    ],
)
def test_a_message_is_found_by_its_fixed_words(seen, kind, next_step, capsys):
    code, shown = explained(seen, capsys)
    if not kind:
        assert code == 2
        assert "no message of this version is like" in shown
        return
    assert code == 0
    assert f"Kind: {kind}, exit code" in shown
    assert next_step in shown


def test_a_cause_inside_other_messages_is_found(capsys):
    code, shown = explained("fr3: the enabling pedal was released 0.400 s into the path; braking began", capsys)
    assert code == 0
    assert shown.startswith("the enabling pedal was released A cause")


def test_every_documented_error_has_advice_and_a_meaning():
    kinds = messages.error_kinds(exit_codes.documented_errors())
    assert len(kinds) > 30
    for name, kind in kinds.items():
        assert exit_codes.exit_code(kind("")) in messages.ADVICE, name
        assert messages.meaning_of(kind).endswith("."), name


def test_every_message_is_nearest_to_itself():
    known = messages.all_messages(frozenset(messages.error_kinds(exit_codes.documented_errors())))
    assert len(known) > 500
    for one in known[::40]:
        assert messages.nearest(one.template, known, 3)[0].template == one.template
