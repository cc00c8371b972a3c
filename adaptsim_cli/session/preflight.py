"""The checks before the first motion. Each gives a sentence; a failing one says what to do."""

from __future__ import annotations

import shutil
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from adaptsim_cli.bench.facts import RigFacts
from adaptsim_cli.bench.rig import Rig
from adaptsim_cli.screen.views import Readiness
from adaptsim_cli.session.records import SessionFacts
from adaptsim_cli.session.target import Target
from calib.types import HandEye
from hw.errors import CameraError, DeviceUnavailable
from perception.raycasting import missing_libraries

MOST_BRIGHTER = 0.15
"""Change of brightness of the picture before the motion, as a share, that is worth a message."""


def brightness(rgb: NDArray[np.uint8]) -> float:
    """The median grey value of a picture (H, W, 3), 0 to 255."""
    return float(np.median(rgb.mean(axis=2)))


def drift(first: RigFacts, now: RigFacts) -> str | None:
    """A message for the operator if the camera's picture differs from the first trial; None: it does not."""
    before, after = _exposed(first), _exposed(now)
    changes = []
    if before and after and before != after:
        changes.append(f"exposure and white balance are {_words(after)}, {_words(before)} in the first trial")
    if first.brightness and now.brightness is not None:
        share = now.brightness / first.brightness - 1.0
        if abs(share) > MOST_BRIGHTER:
            how = "brighter" if share > 0.0 else "darker"
            changes.append(
                f"the picture is {abs(share):.0%} {how} than in the first trial ({first.brightness:.0f} then, "
                f"{now.brightness:.0f} of 255 now; at most {MOST_BRIGHTER:.0%})"
            )
    if not changes:
        return None
    return f"The camera's picture has changed: {'; '.join(changes)}. Restore the light: tracking needs the same colours"


def _exposed(facts: RigFacts) -> list[tuple[int, int]]:
    """Every exposure (µs) and white balance (K) of the recording; empty if the camera does not report them."""
    film: Any = (facts.camera or {}).get("recording") or {}
    return sorted((int(e), int(w)) for e, w in film.get("exposure_us_and_white_balance_K", ()))


def _words(settings: list[tuple[int, int]]) -> str:
    return ", ".join(f"{exposure_us} µs and {balance_K} K" for exposure_us, balance_K in settings)


def preflight(target: Target[Any, Any], facts: SessionFacts, folder: Path, min_free_mb: int) -> tuple[Readiness, ...]:
    """All checks, in the order of the screen. A device that is not ready raises no error."""
    return (
        Readiness("checkpoint", True, f"{facts.checkpoint} ({facts.checkpoint_sha256[:12] or 'no hash'})"),
        _disk(folder, min_free_mb),
        *target.checks(),
    )


def rig_checks(rig: Rig) -> tuple[Readiness, ...]:
    """Calibration, arm and camera; and the libraries of the system, if one is missing."""
    calibration = calibration_check(rig.hand_eye, rig.calibration_days, datetime.now(UTC))
    lacking = missing_libraries()
    libraries = (Readiness("libraries", False, lacking),) if lacking else ()
    return (calibration, *libraries, _arm(rig), *(check() for check in rig.more_checks), _camera(rig))


def calibration_check(eye: HandEye, calibration_days: int, now: datetime) -> Readiness:
    """Never fails. If the calibration is older than `calibration_days`, a sentence says so, and how to check it."""
    detail = f"{eye.source}, ± {eye.sigma_mm:.1f} mm, ± {eye.sigma_deg:.2f}°"
    detail += f", {1e3 * eye.camera_late_s:.1f} ms subtracted from the camera's time stamps"
    days = (now - datetime.fromisoformat(eye.created)).days if eye.created else 0
    if days < 0:
        detail += ". It was made in the future: is the clock of this computer right?"
    if days >= calibration_days:
        detail += f". It is {days} days old: has the camera moved? adaptsim calibrate check, one minute"
    return Readiness("calibration", True, detail)


def _disk(folder: Path, min_free_mb: int) -> Readiness:
    free_mb = shutil.disk_usage(folder).free // 1_000_000
    if free_mb >= min_free_mb:
        return Readiness("disk", True, f"{free_mb / 1000:.1f} GB free")
    return Readiness(
        "disk", False, f"{free_mb} MB free in {folder}, {min_free_mb} MB needed (min_free_mb); remove something"
    )


def _arm(rig: Rig) -> Readiness:
    try:
        state = rig.arm.state()
    except DeviceUnavailable as error:
        return Readiness("arm", False, str(error))
    if state.fault is not None:
        return Readiness("arm", False, f"it reports {state.fault}; clear the fault on the arm, then run again")
    return Readiness("arm", True, f"{rig.arm.model}, no fault")


def _camera(rig: Rig) -> Readiness:
    try:
        model = rig.camera.model()
        rig.camera.snapshot()
    except (CameraError, DeviceUnavailable) as error:
        return Readiness("camera", False, str(error))
    return Readiness("camera", True, f"{model.serial}, {model.colour.width} × {model.colour.height}")
