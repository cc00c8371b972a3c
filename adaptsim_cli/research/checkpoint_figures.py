"""Verifies the card of a checkpoint against rollouts, and says which parameters its sessions identify."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

from adaptsim_cli.config import Config
from adaptsim_cli.wiring.checkpoints import checkpoint_of

ROLLOUTS, QUICK = 240, 96
"""True rollouts of a verification: half a minute of one core, and about ten seconds."""


def verify_figures(config: Config, rollouts: int, progress: Callable[[int, int], None]) -> dict[str, Any]:
    """Load the settings' checkpoint, compare it with card and task, and measure the card's figures again; for JSON.

    Raises CheckpointError if it is corrupt or of another task. `holds` says whether the figures hold.
    """
    from sim.research.pretraining.verification.figures import Figure
    from sim.research.pretraining.verification.figures import verify_figures as verify
    from sim.rollouts import process_pool, run_many

    checkpoint = checkpoint_of(config)
    task = checkpoint.solver.task
    figures: list[Figure] = []
    if rollouts:
        with process_pool(config.workers or None) as executor:
            roll = partial(run_many, task, executor=executor)
            figures = verify(checkpoint, roll, rollouts, config.seed, progress)
    return {
        "task": task.name,
        "folder": str(checkpoint.path),
        "sha256": checkpoint.sha256,
        "holds": all(f.holds for f in figures),
        "figures": [{**asdict(figure), "holds": figure.holds} for figure in figures],
    }


def checkpoint_card(task: str, folder: Path) -> dict[str, Any]:
    """The card of a checkpoint, ready for JSON: null for a figure that is not a number. Raises CheckpointError."""
    from sim.adaptation.checkpoint import read_card

    text = json.dumps(read_card(folder, task).facts(), default=str)
    card: dict[str, Any] = json.loads(text, parse_constant=lambda _: None)
    return card


def tell_parameters(config: Config, progress: Callable[[int, int], None]) -> dict[str, Any]:
    """Which parameters a session with the settings' checkpoint can identify, for JSON. Raises CheckpointError."""
    from sim.adaptation.methods.adaptsim import create
    from sim.research.identifiability import SESSIONS, TRIALS, identifiability

    checkpoint = checkpoint_of(config)
    task = checkpoint.solver.task
    found = identifiability(create(task, checkpoint).simulators, config.seed, progress)
    return {
        "folder": str(checkpoint.path),
        "task": task.name,
        "sessions": SESSIONS,
        "trials": TRIALS,
        "parameters": [
            {"name": one.name, "title": d.title, "left": one.left, "words": one.words}
            for one, d in zip(found, task.parameters.dimensions, strict=True)
        ],
    }
