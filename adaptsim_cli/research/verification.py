"""Verifies a finished pretraining by true rollouts, and writes the document about it."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from pathlib import Path
from typing import TYPE_CHECKING

from sim.tasks.task import Task

if TYPE_CHECKING:
    from sim.research.pretraining.verification.verify import Pretrained


def is_finished(folder: Path | None) -> bool:
    """Whether the pretraining in `folder` is complete enough for a report."""
    from sim.research.pretraining.verification import verify

    return folder is not None and verify.is_finished(folder)


def write_report(
    task: Task, folder: Path, docs: Path | None, executor: Executor, progress: Callable[[str, int, int], None]
) -> Path:
    """Verify the pretraining in `folder`; return its document, `phase1.md` in `docs` (default: in `folder`).

    Rollouts of an earlier call are used again. Raises DatasetError if the pretraining is unfinished or of another task,
    RolloutError.
    """
    from adaptsim_cli.research import phase1_page
    from adaptsim_cli.storage.durable import make_folder
    from sim.research.pretraining.verification.verify import VerificationSettings, load_pretrained, verify

    made = load_pretrained(task, folder.absolute())
    verification = verify(made, VerificationSettings(), executor, progress)
    where = (docs or folder).absolute()
    make_folder(where)
    return phase1_page.write(verification, where, command(made))


def command(made: Pretrained) -> str:
    """The command that repeats it, with the options that differ from their defaults."""
    from sim.research.pretraining.pipeline import PretrainBudget
    from sim.tasks import get_task

    words, planned = ["adaptsim pretrain --task", made.task.name], made.plan["budget"]
    usual, small = PretrainBudget.full(made.task), PretrainBudget.small(made.task)
    if planned["meta"]["episodes"] == small.meta.episodes:
        words, usual = [*words, "--budget small"], small
    if made.task.object_name != get_task(made.task.name).object_name:
        words.append(f"--object {made.task.object_name}.toml")
    if made.wide:
        words.append("--targets wide")
    if made.emulator is not None:
        words += [
            f"--{part} {planned.get(part, 0)}"
            for part in ("rollouts", "denser")
            if planned.get(part, 0) != getattr(usual, part)
        ]
    if planned["meta"]["episodes"] != usual.meta.episodes:
        words.append(f"--episodes {planned['meta']['episodes']}")
    if planned["evaluation"]["targets"] != usual.evaluation.targets:
        words.append(f"--judged {planned['evaluation']['targets']}")
    if made.by_naf:
        words.append("--solver naf")
    return " ".join(words)
