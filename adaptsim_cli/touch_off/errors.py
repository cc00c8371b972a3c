"""Errors of a touch-off, besides those of devices.

PreflightFailed
└── TouchOffFailed       the touches contradict each other, or there was none; nothing stored is replaced
"""

from adaptsim_cli.errors import PreflightFailed


class TouchOffFailed(PreflightFailed):
    """The touch-off has no result; the previous one stays in use."""
