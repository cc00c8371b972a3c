"""What can go wrong in tasks, simulation and learning.

    SimError
    ├── UnknownName          no such task, world, method; the message lists what there is
    ├── WorldError           a world file is malformed; the message names the key
    ├── OutOfRange           a value lies outside of its space; the message names value and range
    ├── NotExecutable        no joint path within the limits does this action
    ├── SolverFailed         the simulation did not converge
    ├── DatasetError         a stored dataset is corrupt or of another kind
    └── CheckpointError      a checkpoint is corrupt, or of another task or version
"""


class SimError(Exception):
    """Base of everything that `sim` raises."""


class UnknownName(SimError):
    """No such task, world or method."""


class WorldError(SimError):
    """A world file is malformed."""


class OutOfRange(SimError):
    """A value lies outside of its space."""


class NotExecutable(SimError):
    """No joint path within the limits does this action."""


class SolverFailed(SimError):
    """The simulation did not converge."""


class DatasetError(SimError):
    """A stored dataset is corrupt, or belongs to another task or scene."""


class CheckpointError(SimError):
    """A checkpoint is corrupt, or belongs to another task or version."""
