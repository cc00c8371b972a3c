"""Joins a finished pretraining with true rollouts and the document that reports on it."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from pathlib import Path

from sim.tasks.task import Task


def is_finished(folder: Path | None) -> bool:
    """Whether a report can be made of the pretraining in `folder` as it is."""
    from sim.adaptation import proof

    return folder is not None and proof.is_finished(folder)


def write_report(
    task: Task, folder: Path, docs: Path | None, executor: Executor, progress: Callable[[str, int, int], None]
) -> Path:
    """Prove what the pretraining in `folder` is worth -> the document, `phase1.md` in `docs` (default: in `folder`).

    Rollouts that an earlier call made are not made again. Raises DatasetError where the pretraining is not finished or
    not of this task, RolloutError.
    """
    from adaptsim_cli.report import phase1
    from adaptsim_cli.session.durable import make_folder
    from sim.adaptation.proof import ProofSettings, load_pretrained, prove

    proof = prove(load_pretrained(task, folder.absolute()), ProofSettings(), executor, progress)
    where = (docs or folder).absolute()
    make_folder(where)
    return phase1.write(proof, where, f"adaptsim pretrain --task {task.name}")
