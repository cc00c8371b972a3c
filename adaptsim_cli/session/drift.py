"""Whether the camera's picture has changed since the session's first trial: exposure, white balance, brightness."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from adaptsim_cli.session.records import RigFacts

MOST_BRIGHTER = 0.15
"""Change of brightness of the picture before the motion, as a share, that is worth a message."""


def brightness(rgb: NDArray[np.uint8]) -> float:
    """The median grey value of a picture (H, W, 3), 0 to 255."""
    return float(np.median(rgb.mean(axis=2)))


def drift(first: RigFacts, now: RigFacts) -> str | None:
    """A message for the operator if the camera's picture differs from the first trial; None: it does not."""
    before, after = _exposed(first), _exposed(now)
    said = []
    if before and after and before != after:
        said.append(f"exposure and white balance are {_words(after)}, {_words(before)} in the first trial")
    if first.brightness and now.brightness is not None:
        share = now.brightness / first.brightness - 1.0
        if abs(share) > MOST_BRIGHTER:
            how = "brighter" if share > 0.0 else "darker"
            said.append(
                f"the picture is {abs(share):.0%} {how} than in the first trial ({first.brightness:.0f} then, "
                f"{now.brightness:.0f} of 255 now; at most {MOST_BRIGHTER:.0%})"
            )
    if not said:
        return None
    return f"The camera's picture has changed: {'; '.join(said)}. Restore the light: tracking needs the same colours"


def _exposed(facts: RigFacts) -> list[tuple[int, int]]:
    """Every exposure (µs) and white balance (K) of the recording; empty if the camera does not report them."""
    film: Any = (facts.camera or {}).get("recording") or {}
    return sorted((int(e), int(w)) for e, w in film.get("exposure_us_and_white_balance_K", ()))


def _words(seen: list[tuple[int, int]]) -> str:
    return ", ".join(f"{exposure_us} µs and {balance_K} K" for exposure_us, balance_K in seen)
