"""Whether the parts of a session are still those that it was begun with."""

from __future__ import annotations

from adaptsim_cli.errors import UsageError
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.session.records import SessionFacts
from adaptsim_cli.session.store import SessionStore
from adaptsim_cli.session.target import SessionParts

_OWN = {
    "calibration or touch-off": ". If camera, table and tool have not moved, the session can continue with its own: "
    "add --own-calibration"
}


def same_parts(store: SessionStore, parts: SessionParts, screen: Screen) -> SessionStore:
    """The store, if its checkpoint, calibration and world are still those that it was begun with."""
    facts, now = store.facts, parts.provenance
    learnt = "checkpoint" if parts.rollouts is None else "physics or a range of the task"
    for what, was, digest in (
        (learnt, facts.checkpoint_sha256, now.checkpoint_sha256),
        ("calibration or touch-off", facts.calibration_sha256, now.calibration_sha256),
        ("camera's time offset", _ms(facts.camera_late_s), _ms(now.camera_late_s)),
        ("recording" if facts.recorded else "world", facts.world_sha256, now.world_sha256),
        ("posterior that it started from", facts.start_from_sha256, now.start_from_sha256),
        ("policy of its control trials", facts.control_sha256, now.control_sha256),
    ):
        if was != digest:
            raise UsageError(
                f"the {what} has changed since session {facts.name!r} was begun ({was[:12]} then, {digest[:12]} now): "
                "its trials cannot be compared with new ones. Restore it, or give another --session"
                + _OWN.get(what, "")
            )
    if changed := changed_file(facts, parts):
        screen.note(changed)
    return store


def changed_file(facts: SessionFacts, parts: SessionParts) -> str:
    """A sentence if the file of the task has changed since the session was begun; empty if not.

    A change of its names, ranges or physics is refused with the checkpoint, so any other change does no harm.
    """
    file = parts.task.file
    if file is None or not facts.task_sha256 or facts.task_sha256 == file.sha256:
        return ""
    return (
        f"{file.path} has changed since the session was begun ({facts.task_sha256[:12]} then, {file.sha256[:12]} now). "
        "Its names, ranges and physics are those of the checkpoint."
    )


def _ms(t_s: float) -> str:
    return f"{1e3 * t_s:.3f} ms"
