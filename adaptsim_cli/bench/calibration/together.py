"""Reads, solves, shows and writes folders of several cameras around one arm."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from adaptsim_cli.bench.calibration import detected_views
from adaptsim_cli.screen import views
from calib import files
from calib.errors import CalibrationRejected, UnusableViews
from calib.foreign.cameras import CameraViews, JointSolution, solve_together
from calib.foreign.chains import any_arm
from calib.foreign.labelling import resolve_symmetry
from calib.foreign.pairing import Fault, pictures_exchanged
from calib.types import reasons


def solve(folders: Sequence[Path], exchange: Sequence[tuple[str, str, str]] = ()) -> JointSolution:
    """Raises ViewFolderError, PerceptionError, UnusableViews; `exchange` are folders' names with two views each."""
    names = [folder.name for folder in folders]
    if len(set(names)) < len(names):
        raise UnusableViews(
            f"two folders have the same name ({', '.join(names)}): a camera takes the name of its folder"
        )
    unknown = sorted({camera for camera, _, _ in exchange} - set(names))
    if unknown:
        raise UnusableViews(f"--exchange names camera {unknown[0]}; there are {', '.join(names)}")
    pairs = {name: [(a, b) for camera, a, b in exchange if camera == name] for name in names}
    return solve_together([_camera(folder, pairs[folder.name]) for folder in folders])


def _camera(folder: Path, pairs: Sequence[tuple[str, str]]) -> CameraViews:
    stored = files.read_folder(folder, any_arm)
    looked = detected_views.detect_views(stored)
    views = looked.views
    if pairs:
        views = resolve_symmetry(pictures_exchanged(views, pairs), looked.setup, stored.forward)
    return CameraViews(folder.name, views, looked.setup, stored.forward)


def show(solution: JointSolution) -> RenderableType:
    """A table with one row per camera."""
    head = ("camera", "at, m in the base", "views", "held out", "alone", "work volume", "alone")
    rows = [
        (
            c.name,
            ", ".join(f"{v:.4f}" for v in c.X_BC[:3, 3]),
            str(len(c.used)),
            f"{c.held_out_px:.2f} px",
            f"{c.alone_held_out_px:.2f} px",
            f"{c.worst_95_mm:.1f} mm",
            f"{c.alone_worst_95_mm:.1f} mm",
        )
        for c in solution.cameras
    ]
    size = f", its size found to ± {100 * solution.size_sigma:.2f} %" if solution.size_sigma else ""
    return Group(
        Text(f"{len(solution.cameras)} cameras, one {solution.target}{size}", style="bold"),
        Text(f"Held-out views are predicted to {solution.held_out_px:.2f} px"),
        views.rows(head, rows),
        Text("work volume: 95 % bound at its worst corner"),
        Text(solution.choice.sentence),
        *(Text(f"  {line}", style="yellow") for line in _notes(solution)),
        Text("Accepted", style="bold green") if solution.accepted else Text("Not accepted", style="bold red"),
    )


def _notes(solution: JointSolution) -> list[str]:
    """Views left out, and their faults."""
    lines = []
    for camera in solution.cameras:
        lines += [f"{camera.name}: view {view.name} not used: {view.reason}" for view in camera.rejected]
        lines += [f"{camera.name}: {fault.sentence}{_option(camera.name, fault)}" for fault in camera.faults]
    return lines


def _option(camera: str, fault: Fault) -> str:
    if fault.kind != "exchanged" or not fault.option:
        return ""
    return f". To use them so: --exchange {camera}:{':'.join(fault.views)}"


def rejected(solution: JointSolution, path: Path) -> CalibrationRejected:
    """The error with every reason, and the remedy."""
    why = [f"{c.name}: {reason}" for c in solution.cameras for reason in reasons(c.gates)]
    error = CalibrationRejected(f"not accepted: {'; '.join(why)}")
    swaps = [_option(c.name, fault).removeprefix(". ") for c in solution.cameras for fault in c.faults]
    step = next((swap for swap in swaps if swap), "")
    first = next(c.name for c in solution.cameras if reasons(c.gates))
    error.add_note(
        f"Written: {path}\nNext: {step or f'adaptsim calibrate solve {first} names the problem of that camera'}"
    )
    return error


def as_json(solution: JointSolution) -> dict[str, Any]:
    """The result for JSON."""
    return {
        "target": solution.target,
        "size_sigma": solution.size_sigma,
        "held_out_px": solution.held_out_px,
        "accepted": solution.accepted,
        "weights": solution.choice.sentence,
        "X_FM": solution.X_FM.tolist(),
        "cameras": [
            {
                "name": c.name,
                "X_BC": c.X_BC.tolist(),
                "views_used": list(c.used),
                "views_rejected": {view.name: view.reason for view in c.rejected},
                "faults": [{"kind": f.kind, "what": f.sentence, "views": f.views} for f in c.faults],
                "gates": [gate.model_dump() for gate in c.gates],
                "fit_px": c.fit_px,
                "held_out_px": c.held_out_px,
                "held_out_alone_px": c.alone_held_out_px,
                "sigma_mm": c.sigma_mm,
                "sigma_alone_mm": c.alone_sigma_mm,
                "worst_95_mm": c.worst_95_mm,
                "worst_95_alone_mm": c.alone_worst_95_mm,
                "from_alone_mm": c.from_alone_mm,
            }
            for c in solution.cameras
        ],
    }


def content(solution: JointSolution) -> bytes:
    """The content of together.json."""
    return (json.dumps(as_json(solution), indent=1, allow_nan=False) + "\n").encode()
