"""From a folder of views to a record: detect, solve, check, judge, in this order."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from statistics import median

from adaptsim_cli.bench.calibration import checking, detected_views
from adaptsim_cli.bench.calibration.orders import fitting_order
from adaptsim_cli.storage.durable import versions
from calib import files
from calib.checks import Residuals, residuals
from calib.errors import UnusableViews
from calib.foreign import pairing
from calib.foreign.chains import any_arm
from calib.foreign.intrinsics_check import TO_REFINE, IntrinsicsCheck
from calib.foreign.labelling import resolve_symmetry
from calib.foreign.pairing import Fault
from calib.records import IntrinsicsRecord
from calib.saved import SavedCalibration, record_calibration
from calib.types import Forward, Setup, Solution, View, ViewInfluence

DEVICES = ("arm", "camera")
"""The devices whose temperatures are stored with a calibration, if reported."""


@dataclass(frozen=True, eq=False)
class SolvedFolder:
    """The result of a folder, with further values for the report."""

    record: SavedCalibration
    setup: Setup
    views: tuple[View, ...]
    images: Mapping[str, Path]  # by the view's name
    not_seen: tuple[str, ...]  # sentences: views without a board, damaged ones
    recognised: tuple[str, ...]  # sentences: conventions that were recognised instead of stated
    faults: tuple[Fault, ...]  # faults of views that do not fit
    residuals: tuple[Residuals, ...]  # of every view that shows the target
    influence: ViewInfluence  # value of each view, and of further ones
    advice: str  # the one most effective next step


@dataclass(frozen=True)
class SolveOptions:
    """The operator's options beyond a plain solution."""

    refine_intrinsics: bool = False  # use the intrinsics estimated from the views
    exchange: tuple[tuple[str, str], ...] = ()  # pairs of views with exchanged poses
    shift: int = 0  # each picture belongs to the pose of the view this many places later
    first: str = ""  # leave out the views before this one
    last: str = ""  # and those after this one


PLAIN = SolveOptions()


def solve_folder(
    folder: Path, *, hw: str = "recorded", created: str = "", options: SolveOptions = PLAIN
) -> SolvedFolder:
    """Solve a folder of views, made now or `created` (ISO 8601).

    Raises ViewFolderError, PerceptionError if no view shows the board, CalibrationError.
    """
    from calib.foreign.intrinsics_check import check as intrinsics_check
    from calib.gates import gates_of

    created = created or datetime.now(UTC).isoformat(timespec="seconds")
    stored = files.read_folder(folder, any_arm)
    looked = detected_views.detect_views(stored)
    views, forward = _chosen_views(looked.views, looked.setup, stored.forward, options), stored.forward
    solution, setup, tried = _solution(stored, views, looked.setup, refine=options.refine_intrinsics)
    refined = options.refine_intrinsics and tried is not None and len(tried.used) >= TO_REFINE
    wrong = pairing.faults(views, setup, forward, solution)
    left = residuals(views, setup, solution, forward)
    checks = checking.checks(folder, stored, setup, views, solution, forward)
    checks.append(intrinsics_check(tried, refined=refined))
    record = record_calibration(
        solution,
        setup.p_AP_m,
        checks,
        gates_of(solution, setup, checks),
        {view.name: view.sha256 for view in stored.views},
        created=created,
        source=_source(hw, created),
        folder=folder.name,  # only the name, so that the data folder can be moved
        hw=hw,
        arm=stored.setup.arm,
        camera=stored.setup.serial,
        board=stored.setup.board.scaled(setup.board.spacing_m / looked.setup.board.spacing_m),
        refined_intrinsics=IntrinsicsRecord.from_camera(setup.colour) if refined else None,
        temperatures_C={
            device: median(temperatures) if (temperatures := checking.readings(stored, device)) else None
            for device in DEVICES
        },
        versions=versions(),
    )
    images = {view.name: folder / view.record.image for view in stored.views if view.record.image is not None}
    return SolvedFolder(
        record, setup, views, images, (*stored.damaged, *looked.left_out), looked.recognised, wrong, left,
        solution.influence, _advice(record, wrong, tried, refined=refined),
    )  # fmt: skip


def _advice(record: SavedCalibration, wrong: Sequence[Fault], tried: IntrinsicsCheck | None, *, refined: bool) -> str:
    """The most effective next step, in words."""
    from calib.foreign.intrinsics_check import rescues

    for fault in wrong:
        if fault.option:
            return f"{fault.sentence}. Solve again with {fault.option}"
        if fault.kind == "mounting":
            return f"{fault.sentence}. Correct it there and solve again"
    if tried is not None and not refined and (helps := rescues(tried)):
        return f"{helps}. Solve again with --refine-intrinsics, or state the right intrinsics"
    bad = [gate for gate in (*record.checks, *record.gates) if gate.verdict == "bad"]
    if bad:
        return f"{bad[0].name}: {bad[0].message.rpartition(': ')[2]}; then solve again"
    return "Record more views, tilted to all sides, and solve again"


def _solution(
    stored: files.Folder, views: Sequence[View], setup: Setup, *, refine: bool
) -> tuple[Solution, Setup, IntrinsicsCheck | None]:
    """Raises UnusableViews, with the order of quaternions that fits, or the fault of the series if one is found."""
    from calib.foreign.intrinsics_check import settle

    forward = stored.forward
    try:
        return settle(views, setup, forward, refine=refine)
    except UnusableViews as error:
        if order := fitting_order(stored):
            raise type(error)(order) from error
        for fault in pairing.faults(views, setup, forward, None):
            error.add_note(f"{fault.sentence}{f'. Try again with {fault.option}' if fault.option else ''}")
        raise


def _chosen_views(
    views: Sequence[View], setup: Setup, forward: Forward | None, options: SolveOptions
) -> tuple[View, ...]:
    """The chosen views, each with its corrected pose. Raises UnusableViews."""
    names = {view.name for view in views}
    for option, name in (("--from", options.first), ("--until", options.last)):
        if name and name not in names:
            raise UnusableViews(f"{option} names view {name}; there are {', '.join(sorted(names))}")
    chosen = pairing.exchanged(views, options.exchange)
    if options.shift:
        chosen = pairing.shifted(chosen, options.shift)
    if options.exchange or options.shift:
        chosen = list(resolve_symmetry(chosen, setup, forward))  # other poses may ask for another end of the target
    return tuple(v for v in chosen if options.first <= v.name and (not options.last or v.name <= options.last))


def _source(hw: str, created: str) -> str:
    where = {"fake": "of the simulated lab", "recorded": "from recorded views"}.get(hw, f"of the {hw}")
    return f"calibration {where}, {created[:10]}"
