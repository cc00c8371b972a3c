"""Writes the verification of a pretraining as a section of a Markdown document, with figures."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from importlib import resources
from pathlib import Path

import numpy as np

from adaptsim_cli.research import phase1_figures
from sim.adaptation.methods.udr import DRAWS as UDR_POLICIES
from sim.research.pretraining.evaluation import LEAST_GAP
from sim.research.pretraining.gate import GATE_TARGETS
from sim.research.pretraining.verification.statistics import RankCorrelation
from sim.research.pretraining.verification.verify import Verification
from sim.storage.files import whole_file
from sim.tasks import TASKS

DOCUMENT = "phase1.md"
BAR = 0.9
"""Share of the noise ceiling that the rank correlation should reach."""

PREAMBLE = """# Phase 1: what the pretrained checkpoints are worth

Made by `adaptsim pretrain --task T --report`: a section a task, each from the folder of its pretraining and from true
rollouts of the simulator. Nothing here is typed by hand. How Phase 1 works stands in `docs/decisions/0006-learning.md`.
Wall times are those of the run that made the checkpoint, with whatever else the machine had to do.
"""

MEMORIES = {
    "iteration": "the last iteration (the paper's)",
    "history": "the whole session",
    "state": "the last iteration, end states only",
}


def write(verification: Verification, folder: Path, command: str) -> Path:
    """Put the section of this task into `phase1.md` of `folder` and its figures into `figures/`; return the document.

    Sections of other tasks stay as they are.
    """
    name = section_name(verification)
    pictures = phase1_figures.draw_all(verification, folder / "figures", name)
    document = folder / DOCUMENT
    before = document.read_text(encoding="utf-8") if document.exists() else PREAMBLE
    with whole_file(document) as temporary:
        temporary.write_text(merged(before, name, section(verification, pictures, command)), encoding="utf-8")
    return document


def section_name(verification: Verification) -> str:
    """The task, plus options that differ from the usual ones: wide targets, NAF as the solver."""
    made = verification.pretrained
    return made.task.name + ("-wide" if made.wide else "") + ("-naf" if made.by_naf else "")


def merged(document: str, name: str, content: str) -> str:
    """`document` with the section `name` replaced or added; sections are in the order of the tasks."""
    found = dict(re.findall(r"<!-- begin (\S+) -->\n(.*?)<!-- end \1 -->\n", document, flags=re.DOTALL))
    found[name] = content.strip() + "\n\n"
    known = list(TASKS)
    order = sorted(found, key=lambda n: (known.index(n.split("-")[0]) if n.split("-")[0] in known else len(known), n))
    parts = (f"<!-- begin {n} -->\n{found[n]}<!-- end {n} -->\n" for n in order)
    return PREAMBLE + "\n" + "\n".join(parts)


def section(verification: Verification, pictures: Sequence[str], command: str) -> str:
    """The section as Markdown."""
    from jinja2 import Environment, StrictUndefined

    made, pairs = verification.pretrained, verification.pairs
    environment = Environment(autoescape=False, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    environment.filters.update(signed=_signed, share=_share, thousands=_thousands, duration=_duration)
    folder = resources.files("adaptsim_cli.research")
    template = environment.from_string((folder / "phase1.md.j2").read_text(encoding="utf-8"))
    held = verification.held_out
    inside = [("inside Ω", held.inside)] if held and held.inside else []
    r = held.reliability if held else None
    targets = "in Ω and the margin around it" if made.wide else "in Ω, as in the paper"
    text = template.render(
        heading=made.task.title[:1].upper()
        + made.task.title[1:]
        + (", targets beyond Ω" if made.wide else "")
        + (", by NAF" if made.by_naf else ""),
        plan=made.plan,
        command=command,
        simulations=sum(s.simulations or 0 for s in verification.stages),
        held=held,
        rows=[("Ω and the margin around it", held.everywhere), *inside] if held else [],
        bins=list(zip(r.predicted, r.observed, r.low, r.high, r.count, strict=True)) if r else [],
        pairs=pairs,
        own=[_own(pairs.emulated), _own(pairs.drake)] if pairs else [],
        ranks=list(zip(pairs.ranks.observed, pairs.ranks.ceiling, strict=True)) if pairs else [],
        rank_verdict=rank_verdict(pairs.ranks) if pairs else "",
        replays=verification.replays,
        memories=MEMORIES,
        policies=made.policies,
        gate_targets=GATE_TARGETS,
        evaluation=made.evaluation,
        targets_from=targets,
        least_gap=LEAST_GAP,
        udr_policies=UDR_POLICIES,
        stages=verification.stages,
        report_rollouts=verification.rollouts,
        pictures={Path(p).stem.rsplit("-", 1)[-1]: p for p in pictures},
    )
    return re.sub(r"\n{3,}", "\n\n", text)


def rank_verdict(ranks: RankCorrelation) -> str:
    """Whether the emulator ranks policies as well as the rollouts can show."""
    if math.isnan(ranks.ratio):
        return (
            f"The policies of different E earn nearly the same in these targets (chance alone makes such differences "
            f"with a probability of {ranks.chance:.2f}), so there is nothing to rank."
        )
    reached = "reached" if ranks.ratio >= BAR else "missed"
    note = ""
    if ranks.ratio < BAR and ranks.mean >= ranks.perfect.low:
        note = " A perfect predictor lies this low by chance too."
    return f"That is {ranks.ratio:.2f} of the ceiling: the bar of {BAR:g} is {reached}.{note}"


def _own(rewards: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> float:
    """Mean of (n, t, r) for policies in the parameters that they were trained for."""
    return float(np.diagonal(rewards.mean(axis=2)).mean())


def _signed(value: float, digits: int) -> str:
    return f"{value:+.{digits}f}".replace("-", "−")


def _share(value: float) -> str:
    return f"{100 * value:.1f} %"


def _thousands(value: float) -> str:
    return f"{int(value):,}"


def _duration(seconds: float | None) -> str:
    if seconds is None:
        return "not measured"
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes:02d} min" if hours else f"{minutes} min {rest:02d} s" if minutes else f"{rest} s"
