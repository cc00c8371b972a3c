"""Errors of perception.

PerceptionError
├── ObjectNotFound       nothing in the search area looks like the object
├── TableNotFound        the table is not seen, or not where the calibration puts it
├── TrackingFailed       found at first, then too little evidence to continue
│   └── OutcomeUnseen    too few frames show the object for an outcome (in sightings)
├── BoardNotFound        too little of the calibration board is seen
├── WrongBoard           markers are seen, but not those of the stated board
└── BoardMirrored        the markers can be read only in the mirror
"""


class PerceptionError(Exception):
    """Base of everything that perception raises."""


class ObjectNotFound(PerceptionError):
    """The object is not where it should be; the message names the searched area. `picture` is what the camera saw, as
    JPEG, if somebody may look at it.
    """

    def __init__(self, message: str, picture: bytes | None = None) -> None:
        super().__init__(message)
        self.picture = picture


class TableNotFound(PerceptionError):
    """Too little of the table is seen where it should be."""


class TrackingFailed(PerceptionError):
    """The frames do not support a track."""


class BoardNotFound(PerceptionError):
    """Too little of the calibration board is seen for a pose; the message gives the likely reason."""


class WrongBoard(PerceptionError):
    """The picture shows another board than the stated one, or is not the stated image."""


class BoardMirrored(PerceptionError):
    """The image, or the print, is mirrored."""
