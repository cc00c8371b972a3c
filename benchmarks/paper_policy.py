"""Does the paper's adaptation policy learn? Three training seeds: learning curves, learning gates, checkpoints.

    python benchmarks/paper_policy.py --tasks pushing scooping --seeds 1 2 --out build/paper-policy
    adaptsim benchmark --task pushing --targets drawn --methods adaptsim-iteration,udr --seeds 3 \
        --checkpoints default,build/paper-policy/pushing-1,build/paper-policy/pushing-2

The emulator and the reward table are those of the shipped checkpoint, whose own policy is seed 0. The training is that
of `adaptsim pretrain --methods`: 10,000 episodes. The gate compares a trained policy with staying where it starts, and
with its own mean drift, in emulated episodes; the second command tests it by true rollouts. Existing trainings are
kept.
"""

from __future__ import annotations

import argparse
from dataclasses import asdict
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from sim.adaptation.checkpoint import Checkpoint, load_checkpoint, save_checkpoint
from sim.research.methods.q_policy import tensors_of
from sim.research.pretraining.dataset_share import stage_seeds
from sim.research.pretraining.episodes import EmulatedRolls, Simulator, fill_library
from sim.research.pretraining.logs import silent
from sim.research.pretraining.meta_training import Gate, MetaSettings, learning_gate, train_adaptation
from sim.storage.files import read_toml, write_toml
from sim.tasks import get_task
from sim.tasks.task import Task

PICTURE = Path("docs/figures/paper-policy.png")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tasks", nargs="+", default=["pushing", "scooping"])
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--out", type=Path, required=True)
    asked = parser.parse_args()
    curves: dict[str, list[dict[str, Any]]] = {}
    for name in asked.tasks:
        task = get_task(name)
        shipped = load_checkpoint(task)
        curves[name] = [shipped.card.facts()["policy"]["iteration"]]
        for seed in asked.seeds:
            curves[name].append(trained(task, shipped, seed, asked.out / f"{name}-{seed}"))
        for number, found in enumerate(curves[name]):
            gate = found["gate"]
            print(
                f"{name}, training {number}: policy {gate['policy']:.3f}, stay {gate['stay']:.3f}, drift "
                f"{gate['drift']:.3f}, above the better {gate['above_ci95'][0]:+.3f} to {gate['above_ci95'][1]:+.3f}",
                flush=True,
            )
    draw(curves)


def trained(task: Task, shipped: Checkpoint, seed: int, folder: Path) -> dict[str, Any]:
    """The learning curve and the gate of one training, which leaves a checkpoint in `folder`."""
    report = folder.with_suffix(".toml")
    if report.exists():
        return read_toml(report)
    assert shipped.emulator is not None
    emulator, settings, draw = shipped.emulator, MetaSettings(), stage_seeds(seed)[2]
    of_training, of_trials = map(int, np.random.SeedSequence(draw, spawn_key=(0,)).generate_state(2))
    acting = fill_library(shipped.solver, draw, settings.library)
    simulator = Simulator(shipped.solver, acting, EmulatedRolls(emulator, np.random.default_rng(of_trials)))
    network, curve, _ = train_adaptation(simulator, settings, of_training, "iteration", _quiet, silent)
    gate: Gate = learning_gate(simulator, network, "iteration", of_training + 1, settings.targets)
    found = {"gate": asdict(gate), "reward": np.round(curve[:, 0], 4).tolist()}
    facts: dict[str, Any] = {"seed": seed, "simulations": shipped.card.simulations}
    facts |= {"emulator": shipped.card.facts()["emulator"], "policy": {"iteration": found}}
    save_checkpoint(task, folder, emulator, tensors_of({"iteration": network}), facts, shipped.reward_table)
    write_toml(report, found)
    return found


def draw(curves: dict[str, list[dict[str, Any]]]) -> None:
    """Expected reward over the training, one line per seed, beside the rewards of staying and drifting."""
    figure, axes = plt.subplots(1, len(curves), figsize=(4.2 * len(curves), 3.0), squeeze=False)
    for axis, (name, found) in zip(axes[0], curves.items(), strict=True):
        for seed, one in enumerate(found):
            rewards = np.array(one["reward"])
            episodes = np.linspace(0, MetaSettings().episodes, len(rewards) + 1)[1:]
            axis.plot(episodes, rewards, label=f"seed {seed}")
            axis.plot(episodes[-1], one["gate"]["policy"], "o", color=axis.lines[-1].get_color())
        for kind, style in (("stay", ":"), ("drift", "--")):
            axis.axhline(np.mean([one["gate"][kind] for one in found]), color="0.4", linestyle=style, label=kind)
        axis.set(title=name, xlabel="episodes", ylabel="expected reward (emulated)")
        axis.legend(fontsize=7)
    figure.tight_layout()
    figure.savefig(PICTURE, dpi=110)
    print(f"Written: {PICTURE}")


def _quiet(done: int, total: int) -> None:
    """Show no progress."""


if __name__ == "__main__":
    main()
