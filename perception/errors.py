"""What can go wrong in tracking.

PerceptionError
├── ObjectNotFound       nothing in the search area looks like the object
└── TrackingFailed       found at first, then too little evidence to go on
"""


class PerceptionError(Exception):
    """Base of everything that perception raises."""


class ObjectNotFound(PerceptionError):
    """The object is not where it should be; the message says where was searched."""


class TrackingFailed(PerceptionError):
    """The frames do not support a track."""
