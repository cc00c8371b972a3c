"""Names for shell completion. Light, because every press of Tab starts the program."""

from __future__ import annotations

from importlib.metadata import entry_points
from pathlib import Path

_WORLDS = Path(__file__).parents[2] / "sim/worlds"


def sessions(incomplete: str) -> list[str]:
    """Sessions of this machine that begin like this."""
    from adaptsim_cli import config

    folder = config.places().sessions
    return _like(incomplete, [entry.name for entry in folder.iterdir() if entry.is_dir()] if folder.is_dir() else [])


def archived(incomplete: str) -> list[str]:
    """Archived sessions that begin like this."""
    from adaptsim_cli import config

    folder = config.places().data / "archived-sessions"
    return _like(incomplete, [entry.name for entry in folder.iterdir()] if folder.is_dir() else [])


def rollouts(incomplete: str) -> list[str]:
    """Rollouts of this machine that begin like this."""
    from adaptsim_cli import config

    folder = config.places().data / "rollouts"
    return _like(incomplete, [entry.name for entry in folder.iterdir()] if folder.is_dir() else [])


def tasks(incomplete: str) -> list[str]:
    """Tasks that begin like this, those of installed packages too."""
    ours = {folder.name for folder in _WORLDS.iterdir() if folder.is_dir()}
    return _like(incomplete, list(ours | {entry.name for entry in entry_points(group="adaptsim.tasks")}))


def worlds(incomplete: str) -> list[str]:
    """Shipped worlds of all our tasks that begin like this; the shell completes files itself."""
    return _like(incomplete, list({file.stem for file in _WORLDS.glob("*/*.toml")}))


def formats(incomplete: str) -> list[str]:
    """Formats of `sessions export` that begin like this."""
    return _like(incomplete, ["csv", "parquet", "mcap", "lerobot", "rerun"])


def _like(incomplete: str, names: list[str]) -> list[str]:
    return sorted(name for name in names if name.startswith(incomplete) and not name.startswith("."))
