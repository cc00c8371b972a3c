"""The figures of the report on Phase 1, as PNG files."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sim.research.pretraining.verification.emulator import HeldOut
from sim.research.pretraining.verification.policies import Pairs
from sim.research.pretraining.verification.verify import Verification
from sim.storage.files import whole_file

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

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


def emulator(held: HeldOut) -> Figure:
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
