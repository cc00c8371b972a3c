"""Errors of tasks, simulation and learning.

SimError
├── UnknownName          no such task, world, method; the message lists what there is
├── TaskError            a task or its file is wrong; the message names the argument or the line, and the remedy
├── WorldError           a world file is malformed; the message names the key
├── ObjectError          the file of an own object is malformed or has impossible ranges; the message names the key
├── OutOfRange           a value lies outside its space; the message names value and range
├── NoHardware           the task runs in simulation only, and an arm was asked for
├── NotExecutable        no joint path within the limits does this action
│   └── ActionImpossible  the robot of a lab cannot do this action; another one is chosen
├── RolloutError         a rollout raised or its worker died; the message names them
├── ClusterUnavailable   no scheduler answers, it was lost, or a worker has other versions
├── ExtraMissing         a method or world needs packages that are not installed; the message has the line to install
│                        them
├── MomentsMissing       a method needs moments of a trial that were not observed
├── RecordingsRefused    recorded trials cannot serve as a target; the message names the trial and the defect
├── CollapsedPosterior   too few samples carry a posterior for an interval
├── DatasetError         a stored dataset is corrupt or of another kind
└── CheckpointError      a checkpoint is corrupt, or of another task or version
"""

from collections.abc import Iterator
from contextlib import contextmanager


class SimError(Exception):
    """Base of everything that `sim` raises."""


class UnknownName(SimError):
    """No such task, world or method."""


class TaskError(SimError):
    """A task, or the file that declares it, is wrong."""


class WorldError(SimError):
    """A world file is malformed."""


class ObjectError(SimError):
    """The file of an own object is malformed, or its ranges are impossible."""


class OutOfRange(SimError):
    """A value lies outside its space."""


class NoHardware(SimError):
    """The task runs in simulation only, and an arm was asked for."""


class NotExecutable(SimError):
    """No joint path within the limits does this action."""


class ActionImpossible(NotExecutable):
    """The robot of a lab cannot do this action; another one is chosen."""


class RolloutError(SimError):
    """A rollout raised, or its worker died."""


class ClusterUnavailable(SimError):
    """No scheduler answers, the scheduler was lost, or its workers would compute other numbers."""


class ExtraMissing(SimError):
    """Packages of an optional extra are not installed."""


class CollapsedPosterior(SimError):
    """Too few samples carry a posterior for an interval."""


class DatasetError(SimError):
    """A stored dataset is corrupt, or belongs to another task or scene."""


class CheckpointError(SimError):
    """A checkpoint is corrupt, or belongs to another task or version."""


class MomentsMissing(SimError):
    """A method needs moments of a trial that were not observed."""


class RecordingsRefused(SimError):
    """Recorded trials cannot serve as a target."""


@contextmanager
def simulating(task: str, inputs: str) -> Iterator[None]:
    """Run the simulator of a task, of any package: whatever it raises is a RolloutError, except our own errors."""
    try:
        yield
    except SimError:
        raise
    except Exception as error:
        raise RolloutError(
            f"the task {task} cannot simulate {inputs}: {type(error).__name__}: {error}; its `simulate` must return a "
            "track for every action"
        ) from error
