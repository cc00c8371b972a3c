"""Errors of the command line: settings, readiness, the operator, stored sessions.

CliError
├── UsageError           a wrong flag, setting or combination of them
├── PreflightFailed      something is not ready; nothing has moved
├── StoppedByOperator    the operator chose to stop; everything completed is kept
├── Interrupted          Ctrl-C; everything completed is kept
├── AnswerAwaited        a trial was asked for, and its answer comes later
├── AnswerRefused        the answer to a trial is missing or cannot count; it is kept, and may be corrected
└── SessionError         a stored session is corrupt, missing or cannot be written
    └── DiskFull         no room left for the next record
"""


class CliError(Exception):
    """Base of everything that the command line itself raises."""


class UsageError(CliError):
    """A wrong flag, setting or combination of them."""


class PreflightFailed(CliError):
    """Something is not ready; nothing has moved."""


class StoppedByOperator(CliError):
    """The operator chose to stop."""


class Interrupted(CliError):
    """The operator pressed Ctrl-C."""


class AnswerAwaited(CliError):
    """A trial was asked for, and its answer comes later."""


class AnswerRefused(CliError):
    """The answer to a trial is missing or cannot count; it is kept, and may be corrected."""


class SessionError(CliError):
    """A stored session is corrupt, missing or cannot be written."""


class DiskFull(SessionError):
    """No room left for the next record."""
