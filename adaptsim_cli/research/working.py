"""Where the work of a long command is done: on which workers, in which folder, and which share of it."""

from __future__ import annotations

import fcntl
import re
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from adaptsim_cli.config import Resolved
from adaptsim_cli.errors import UsageError
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.screen.continuing import how_to_continue
from adaptsim_cli.screen.reply import Reply
from adaptsim_cli.storage.durable import LOCK, locked, make_folder

if TYPE_CHECKING:
    from sim.rollouts.shares import Share

StageProgress = Callable[[str, int, int], None]
"""(stage, done, total)"""


def simulations(resolved: Resolved, scheduler: str, screen: Screen) -> AbstractContextManager[Executor]:
    """The executor of simulations: the workers of the Dask `scheduler`, or processes of this computer. The screen
    names workers that are left out.

    Raises UsageError if both --workers and a scheduler were given, ClusterUnavailable, ExtraMissing.
    """
    from sim.rollouts.executors import simulating_executor

    if scheduler and "workers" in resolved.flags:
        raise UsageError("--workers counts processes of this computer, --scheduler uses others: leave one of them out")
    return simulating_executor(resolved.config.workers, scheduler, screen.note)


def share_of(text: str, screen: Screen) -> Share | None:
    """The share K/N; None for the whole work. Raises UsageError."""
    from sim.rollouts.shares import Share

    if not text:
        return None
    if screen.as_json:
        raise UsageError("--share computes a part and has no result as JSON: leave --json out")
    written = re.fullmatch(r"(\d+)/(\d+)", text)
    if written is not None and 1 <= int(written[1]) <= int(written[2]):
        return Share(int(written[1]), int(written[2]))
    raise UsageError(f"--share {text}: write K/N with K from 1 to N, for example 2/8")


def complete(share: Share, contents: str, folder: Path) -> Reply:
    """The end of a share."""
    joined = "Once all shares are complete, the same command without --share joins them."
    return Reply(text=[f"Share {share} is complete: {contents} in {folder}", joined])


@contextmanager
def working_in(folder: Path, busy: str, share: Share | None = None) -> Iterator[None]:
    """A context manager: inside, only this process writes into `folder`; a share writes only files of its own.

    An interruption says how to continue. If another process works there, raises SessionError with the sentence `busy`,
    in which {} becomes the folder.
    """
    make_folder(folder)
    with how_to_continue("Finished parts are kept: the same command continues", "interrupted"):
        if share is None:
            with locked(folder, busy.format(folder)):
                yield
        else:
            own = f"{LOCK}-{share.number}-of-{share.count}"
            twice = f"share {share} is running in {folder}: give this one another number"
            with locked(folder, busy.format(folder), kind=fcntl.LOCK_SH), locked(folder, twice, file=own):
                yield
