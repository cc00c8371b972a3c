"""Writes the verification of a pretraining as a section of a Markdown document, with figures."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sim.adaptation.methods.udr import DRAWS as UDR_POLICIES
from sim.research.pretraining.evaluation import LEAST_GAP
from sim.research.pretraining.meta_training import GATE_TARGETS
from sim.research.pretraining.verification.policies import Pairs
from sim.research.pretraining.verification.statistics import RankCorrelation
from sim.research.pretraining.verification.verify import EmulatorHeldOut, Verification
from sim.storage.files import whole_file
from sim.tasks import TASKS
from sim.tasks.task import Task

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from sim.research.pretraining.verification.verify import Pretrained


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
    pictures = draw_all(verification, folder / "figures", name)
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


DPI = 100
COLOURS = ("#1f6f8b", "#d1495b", "#8a8a8a", "#66a182", "#edae49")


def draw_all(verification: Verification, folder: Path, name: str) -> tuple[str, ...]:
    """Write `phase1-NAME-*.png` into `folder` -> the file names, in the order of the report."""
    drawn: dict[str, Figure] = {}
    if verification.held_out is not None:
        drawn["emulator"] = emulator(verification.held_out)
    if verification.pairs is not None:
        drawn["policies"] = policies(verification.pairs)
    drawn["learning"] = learning(verification)
    files = []
    for what, figure in drawn.items():
        files.append(f"phase1-{name}-{what}.png")
        with whole_file(folder / files[-1]) as temporary:
            figure.savefig(temporary, dpi=DPI, format="png")
    return tuple(files)


def emulator(held: EmulatorHeldOut) -> Figure:
    """Predicted against observed successes, their counts, and errors of the position."""
    figure, (left, middle, right) = _panels(3)
    bins, count = held.reliability, held.reliability.count
    there = count > 0
    error = np.stack([bins.observed - bins.low, bins.high - bins.observed])[:, there]
    left.plot([0, 1], [0, 1], color="black", linewidth=0.8, linestyle=":")
    left.errorbar(
        bins.predicted[there],
        bins.observed[there],
        np.maximum(error, 0.0),
        fmt="o",
        markersize=5,
        capsize=3,
        color=COLOURS[0],
    )
    left.set(xlabel="predicted probability of success", ylabel="observed share (95 %)", xlim=(0, 1), ylim=(0, 1))
    left.set_title("Outcome", fontsize=10)
    middle.bar(np.arange(len(count)) / len(count) + 0.05, count, width=0.09, color=COLOURS[0])
    middle.set(xlabel="predicted probability of success", ylabel="held-out rollouts", xlim=(0, 1))
    middle.set_title("How often each was predicted", fontsize=10)
    errors_mm = np.sort(held.position_errors) * 1e3
    right.plot(errors_mm, (np.arange(len(errors_mm)) + 1) / max(len(errors_mm), 1), color=COLOURS[0])
    right.set(xlabel="error of the last position, mm", ylabel="share of rollouts below", ylim=(0, 1), xscale="log")
    right.set_title("Where the object ends", fontsize=10)
    right.grid(alpha=0.3)
    return figure


def policies(pairs: Pairs) -> Figure:
    """True rewards of the two kinds of policies, pair by pair; expected rewards against true ones."""
    figure, (left, right) = _panels(2)
    emulated, drake = pairs.emulated.mean(axis=2), pairs.drake.mean(axis=2)
    for j in range(emulated.shape[1]):
        colour, label = COLOURS[j % len(COLOURS)], f"target {j + 1}"
        left.plot(drake[:, j], emulated[:, j], "o", markersize=5, alpha=0.7, color=colour, label=label)
        right.plot(pairs.expected[:, j], emulated[:, j], "o", markersize=5, alpha=0.7, color=colour)
    for axes in (left, right):
        axes.plot([0, 1], [0, 1], color="black", linewidth=0.8, linestyle=":")
        axes.set(xlim=(-0.03, 1.03), ylim=(-0.03, 1.03))
        axes.grid(alpha=0.3)
    rollouts = pairs.emulated.shape[2]
    left.set(xlabel="policy from true rollouts", ylabel="policy from the emulator")
    left.set_title(f"True reward of each pair, {rollouts} rollouts", fontsize=10)
    left.legend(fontsize=8, loc="lower right")
    right.set(xlabel="reward that the emulator expects", ylabel="true reward")
    right.set_title("The emulator's policies, all E in each target", fontsize=10)
    return figure


def learning(verification: Verification) -> Figure:
    """The learning curve of the adaptation policy, and the gap closed by each method after each iteration."""
    figure, (left, middle, right) = _panels(3)
    made = verification.pretrained
    curve, parallel = made.policies["iteration"], int(made.plan["budget"]["meta"]["parallel"])
    _learning_curve(left, curve, parallel)
    loss = np.asarray(curve["loss"])
    middle.plot(parallel * (np.arange(len(loss)) + 1), loss, color=COLOURS[0], linewidth=1)
    middle.set(xlabel="episodes", ylabel="loss", yscale="log" if (loss > 0).all() else "linear")
    middle.set_title("Q-learning", fontsize=10)
    for i, score in enumerate(made.evaluation.methods):
        closed, interval = np.asarray(score.gap_closed), np.asarray(score.gap_closed_ci95)
        x = np.arange(1, len(closed) + 1) + 0.08 * i
        low, high = np.maximum(closed - interval[:, 0], 0.0), np.maximum(interval[:, 1] - closed, 0.0)
        colour = COLOURS[i % len(COLOURS)]
        right.errorbar(x, closed, [low, high], fmt="o-", markersize=4, capsize=3, color=colour, label=score.name)
    right.axhline(0.0, color="black", linewidth=0.8)
    right.axhline(1.0, color="black", linewidth=0.8, linestyle=":")
    right.set(xlabel="iteration", ylabel="share of the gap closed (95 %)")
    right.set_title("Unseen targets, true rollouts", fontsize=10)
    right.legend(fontsize=8, loc="lower right")
    return figure


def _learning_curve(axes: Axes, curve: Mapping[str, Any], parallel: int) -> None:
    reward, epsilon = np.asarray(curve["reward"]), np.asarray(curve["epsilon"])
    episodes = parallel * (np.arange(len(reward)) + 1)
    axes.plot(episodes, reward, color=COLOURS[0], label="mean reward of visited parameters")
    axes.plot(episodes, epsilon, color=COLOURS[2], linestyle="--", linewidth=1, label="share of random steps")
    for kind, colour in (("stay", COLOURS[1]), ("drift", COLOURS[4])):
        axes.axhline(curve["gate"][kind], color=colour, linewidth=0.8, linestyle=":", label=f"gate: {kind}")
    axes.set(xlabel="episodes", ylim=(0, 1.02))
    axes.set_title("The paper's adaptation policy in training", fontsize=10)
    axes.legend(fontsize=8)


def _panels(count: int) -> tuple[Figure, tuple[Axes, ...]]:
    # Without pyplot: no window system, and no global state to close.
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(3.9 * count, 3.4), layout="constrained")
    FigureCanvasAgg(figure)
    return figure, tuple(np.atleast_1d(figure.subplots(1, count)))


def write_report(
    task: Task, folder: Path, docs: Path | None, executor: Executor, progress: Callable[[str, int, int], None]
) -> Path:
    """Verify the pretraining in `folder`; return its document, `phase1.md` in `docs` (default: in `folder`).

    Rollouts of an earlier call are used again. Raises DatasetError if the pretraining is unfinished or of another task,
    RolloutError.
    """
    from adaptsim_cli.storage.durable import make_folder
    from sim.research.pretraining.verification.verify import VerificationSettings, load_pretrained, verify

    made = load_pretrained(task, folder.absolute())
    verification = verify(made, VerificationSettings(), executor, progress)
    where = (docs or folder).absolute()
    make_folder(where)
    return write(verification, where, command(made))


def command(made: Pretrained) -> str:
    """The command that repeats it, with the options that differ from their defaults."""
    from sim.research.pretraining.pipeline import PretrainBudget
    from sim.tasks import get_task

    words, planned = ["adaptsim pretrain --task", made.task.name], made.plan["budget"]
    usual, small = PretrainBudget.full(made.task), PretrainBudget.small(made.task)
    if planned["meta"]["episodes"] == small.meta.episodes:
        words, usual = [*words, "--budget small"], small
    if made.task.object_name != get_task(made.task.name).object_name:
        words.append(f"--object {made.task.object_name}.toml")
    if made.wide:
        words.append("--targets wide")
    if made.emulator is not None:
        words += [
            f"--{part} {planned.get(part, 0)}"
            for part in ("rollouts", "denser")
            if planned.get(part, 0) != getattr(usual, part)
        ]
    if planned["meta"]["episodes"] != usual.meta.episodes:
        words.append(f"--episodes {planned['meta']['episodes']}")
    if planned["evaluation"]["targets"] != usual.evaluation.targets:
        words.append(f"--judged {planned['evaluation']['targets']}")
    if made.by_naf:
        words.append("--solver naf")
    return " ".join(words)
