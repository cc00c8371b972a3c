"""One capture of libk4a, copied out of the library's memory, and its conversion to a `Frame`."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from hw.camera.k4a_library import K4aLibrary
from hw.camera.k4a_types import COLOR_MJPG, DEPTH16, IR16
from hw.errors import CameraError
from hw.types import Frame

_LATE_S = 1.0  # an arrival stamp further from now comes from another clock


@dataclass(frozen=True, eq=False)
class Captured:
    """One instant. The colour image is still a JPEG, so that nothing is decoded while the arm moves."""

    device_s: float  # middle of the colour image's exposure, on the device's clock
    arrived_s: float  # on the host's monotonic clock
    jpeg: bytes
    depth_mm: NDArray[np.uint16]  # (Hd, Wd)
    infrared: NDArray[np.uint16] | None  # (Hd, Wd)
    exposure_us: int  # of the colour image, as the device reports; 0: not reported
    white_balance_K: int

    def frame(self, t_s: float) -> Frame:
        """Decoded, with its time on the arm's clock. Raises CameraError."""
        return Frame(t_s, decode_jpeg(self.jpeg), self.depth_mm, self.infrared)


def read_capture(library: K4aLibrary, capture: ctypes.c_void_p, now_s: float, *, infrared: bool) -> Captured | None:
    """Copy a capture; None where colour or depth is missing, or infrared where it is asked for.

    `now_s` is the host's monotonic time. It replaces the library's arrival stamp if that is missing or comes from
    another clock (recordings, Orbbec's library). Raises CameraError on a format that was not asked for.
    """
    with (
        _image(library, library.k4a_capture_get_color_image, capture) as colour,
        _image(library, library.k4a_capture_get_depth_image, capture) as depth,
        _image(library, library.k4a_capture_get_ir_image, capture) as dark,
    ):
        if colour is None or depth is None or (infrared and dark is None):
            return None
        if (kind := library.k4a_image_get_format(colour)) != COLOR_MJPG:
            raise CameraError(
                f"the camera sends colour in format {kind} instead of MJPG ({COLOR_MJPG}): unplug it, plug it in again "
                "and run the command again"
            )
        device_s = 1e-6 * library.k4a_image_get_device_timestamp_usec(colour)
        stamped_s = 1e-9 * library.k4a_image_get_system_timestamp_nsec(colour)
        return Captured(
            device_s=device_s,
            arrived_s=stamped_s if 0.0 <= now_s - stamped_s <= _LATE_S else now_s,
            jpeg=_content(library, colour),
            depth_mm=_grey(library, depth, DEPTH16),
            infrared=_grey(library, dark, IR16) if infrared else None,
            exposure_us=int(library.k4a_image_get_exposure_usec(colour)),
            white_balance_K=int(library.k4a_image_get_white_balance(colour)),
        )


def decode_jpeg(jpeg: bytes) -> NDArray[np.uint8]:
    """(H, W, 3) RGB. Raises CameraError."""
    image = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    if image is None:
        raise CameraError(f"a colour image of {len(jpeg)} bytes cannot be decoded: check the camera's USB cable")
    return np.ascontiguousarray(image[..., ::-1], dtype=np.uint8)


@contextmanager
def _image(
    library: K4aLibrary, get: Callable[[ctypes.c_void_p], int | None], capture: ctypes.c_void_p
) -> Iterator[ctypes.c_void_p | None]:
    address = get(capture)
    if not address:
        yield None
        return
    image = ctypes.c_void_p(address)
    try:
        yield image
    finally:
        library.k4a_image_release(image)


def _content(library: K4aLibrary, image: ctypes.c_void_p) -> bytes:
    return ctypes.string_at(library.k4a_image_get_buffer(image), library.k4a_image_get_size(image))


def _grey(library: K4aLibrary, image: Any, kind: int) -> NDArray[np.uint16]:
    if (found := library.k4a_image_get_format(image)) != kind:
        raise CameraError(
            f"the camera sends an image of format {found} instead of {kind}, 16-bit grey: unplug it, plug it in again "
            "and run the command again"
        )
    width, height = library.k4a_image_get_width_pixels(image), library.k4a_image_get_height_pixels(image)
    stride = library.k4a_image_get_stride_bytes(image)
    content = _content(library, image)
    if stride < 2 * width or len(content) < stride * height:
        raise CameraError(
            f"a depth image of {width} x {height} has only {len(content)} bytes: check the camera's USB cable"
        )
    rows = np.frombuffer(content, "<u2", count=stride * height // 2).reshape(height, -1)
    return np.ascontiguousarray(rows[:, :width], dtype=np.uint16)
