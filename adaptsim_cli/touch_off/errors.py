"""What can go wrong in a touch-off, beside what devices raise.

PreflightFailed
└── TouchOffFailed       what was touched does not make sense, or nothing was; nothing stored is replaced
"""

from adaptsim_cli.errors import PreflightFailed


class TouchOffFailed(PreflightFailed):
    """The touch-off has no result; what was in use stays in use."""
