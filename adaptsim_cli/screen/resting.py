"""Names the open sessions that rest on the calibration or touch-off of a rig."""

from __future__ import annotations

from collections.abc import Sequence

from adaptsim_cli.screen.console import Screen


def tell_resting(screen: Screen, what: str, sessions: Sequence[str]) -> None:
    """Name the `sessions` that use `what`, if there are any."""
    if not sessions:
        return
    many = "s" if len(sessions) > 1 else ""
    screen.note(f"Open session{many} that rest{'' if many else 's'} on {what}: {', '.join(sessions)}.")
    screen.plain("Once it is replaced, each can continue only with its own, if the camera has not moved:")
    screen.plain(f"  adaptsim run-iteration --session {sessions[0]} --own-calibration")
