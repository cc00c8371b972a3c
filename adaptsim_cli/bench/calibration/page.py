"""Writes a calibration as one self-contained HTML page."""

from __future__ import annotations

import base64
from importlib import resources

import cv2
import numpy as np

from adaptsim_cli.bench.calibration import figures, pictures
from adaptsim_cli.bench.calibration.solving import SolvedFolder
from adaptsim_cli.screen import views
from calib.saved import SavedCalibration
from hw.bounded import encode_image
from perception.board import locate
from perception.errors import BoardNotFound

PICTURES, PICTURE_PX = 6, 720


def render(solved: SolvedFolder) -> str:
    """The page as HTML."""
    from jinja2 import Environment, StrictUndefined

    record = solved.record
    used = frozenset(view.name for view in record.views if view.used)
    template_file = resources.files("adaptsim_cli.bench.calibration") / "page.html.j2"
    style_file = resources.files("adaptsim_cli.screen") / "style.css"
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    environment.filters |= {"signed": views.signed, "with_signs": views.with_signs}
    template = environment.from_string(template_file.read_text(encoding="utf-8"))
    X = np.array(record.X_AC)
    fixed = record.mounting == "fixed"
    return template.render(
        record=record,
        style=style_file.read_text(encoding="utf-8"),
        verdict=_verdict(record),
        used=len(used),
        not_seen=solved.not_seen,
        recognised=solved.recognised,
        board=record.board.board().name,
        figure_coverage=figures.coverage(solved.views, used, solved.setup.colour),
        figure_residuals=figures.residuals(record.views),
        figure_vectors=figures.vectors(solved.residuals, solved.setup.colour),
        enlarged=figures.ENLARGED,
        figure_work=figures.work_volume(record.uncertainty, (X[0, 3], X[1, 3])) if fixed else "",
        pictures=_pictures(solved, used),
    )


def _verdict(record: SavedCalibration) -> str:
    bad = [gate.message for gate in (*record.gates, *record.checks) if gate.verdict == "bad"]
    good = "It is good to use" if record.hw == "recorded" else "It is in use"
    if bad:
        return "It is not used: " + "; ".join(bad)
    suspect = [check.name for check in (*record.checks, *record.gates) if check.verdict == "suspect"]
    if suspect:
        return f"{good}. Check the suspect points: " + ", ".join(suspect) + "."
    return f"{good}, and no check speaks against it."


def _pictures(solved: SolvedFolder, used: frozenset[str]) -> list[tuple[str, str]]:
    """Pictures of views spread over the series, unused views first."""
    odd = [view for view in solved.views if view.name not in used][: PICTURES // 2]
    good = [view for view in solved.views if view.name in used]
    chosen = [good[i] for i in np.linspace(0, len(good) - 1, PICTURES - len(odd)).astype(int)] if good else []
    shown = []
    for view in dict.fromkeys([*odd, *chosen]):
        path = solved.images.get(view.name)
        image = None if path is None else cv2.imread(str(path), cv2.IMREAD_COLOR)
        if image is None:
            continue
        try:
            pose = locate(view.corners, solved.setup.board, solved.setup.colour)
        except BoardNotFound:
            continue
        jpeg = pictures.draw_view(
            np.ascontiguousarray(image[..., ::-1], dtype=np.uint8),
            view.corners, pose.X_VM, (), solved.setup.board, solved.setup.colour,
        )  # fmt: skip
        shown.append((view.name, _url(jpeg)))
    return shown


def _url(jpeg: bytes) -> str:
    """A data URL of the reduced picture."""
    image = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    if image is None:
        return ""
    scale = min(1.0, PICTURE_PX / image.shape[1])
    small = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return "data:image/jpeg;base64," + base64.b64encode(encode_image(small, ".jpg", 82)).decode()
