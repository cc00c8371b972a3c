"""Are the statements of a session true? The number of trials that it needs, and whether its predictions inform.

    python benchmarks/forecasts.py --task pendulum --targets drawn
    python benchmarks/forecasts.py --task scooping --targets foods     needs the worlds' tables (adaptsim world-tables)

In each world one session of the default method runs to its end, and is compared with the forecast beside the checkpoint
(`adaptsim checkpoints trials`). Pairs with UDR continue with the final policy until a gain is shown. Then the same
session runs with answers that belong to other actions: there the verdict has to say that the predictions say nothing.
Sessions are stored in `--out`; the same command continues.
"""

from __future__ import annotations

import argparse
import json
import zlib
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from world_sources import source_in

from hw.types import Array
from sim.adaptation.checkpoint import Checkpoint, load_checkpoint
from sim.adaptation.method import FAILED, Trial
from sim.adaptation.methods.udr import udr_policies
from sim.adaptation.paired import is_gain_shown
from sim.adaptation.trials_forecast import MOST_PAIRS, TrialsForecast, load
from sim.adaptation.trials_needed import Play, course
from sim.adaptation.verdict import Kind
from sim.research.benchmark.worlds import targets_of
from sim.tasks import get_task

PARTICLES = 2
NEAR = {0.1: (0.05, 0.15), 0.2: (0.15, 0.3), 0.4: (0.3, 0.5)}
"""The gains over UDR of worlds that a row of the forecast stands for."""


@dataclass(frozen=True)
class Course:
    """One session, as it is kept."""

    world: str
    rewards: list[float]
    predicted: list[float]
    kinds: list[str]  # of the verdict after each iteration
    first_success: int | None
    gain: float  # over UDR, mean of all pairs
    pairs: int | None  # until it was shown
    final: float  # mean reward of the final policy beside UDR
    udr: float


def kept_course(checkpoint: Checkpoint, world: str, play_in: Play, seed: int, *, wired: bool) -> Course:
    """Run a session; with `wired` the outcomes are those of its actions, otherwise those of random ones."""
    task, rng = checkpoint.solver.task, np.random.default_rng((seed, 1))
    udr = udr_policies(checkpoint.solver, np.random.default_rng((seed, 2)))[0]
    others = np.random.default_rng((seed, 3, zlib.crc32(world.encode())))

    def shuffled(contexts: Array, actions: Array, rng: np.random.Generator) -> tuple[Trial, ...]:
        trials = play_in(contexts, task.action.sample(others, len(actions)), rng)
        return tuple(replace(trial, action=action) for trial, action in zip(trials, actions, strict=True))

    one = course(checkpoint, play_in if wired else shuffled, udr, rng, particles=PARTICLES)
    final, contexts = one.adaptation.final(one.history), task.context.sample(rng, MOST_PAIRS)
    after = [trial.reward for trial in play_in(contexts, final.actions(contexts), rng)]
    beside = [trial.reward for trial in play_in(contexts, udr.actions(contexts), rng)]
    differences = np.concatenate([one.differences, np.array(after) - beside])[:MOST_PAIRS]
    is_shown = is_gain_shown(differences, MOST_PAIRS)
    return Course(
        world,
        [trial.reward for trial in one.trials],
        [trial.predicted for trial in one.trials],
        [kind.value for kind in one.kinds],
        one.first_success,
        float(differences.mean()),
        int(is_shown.argmax()) + 1 if is_shown.any() else None,
        float(np.mean(after)),
        float(np.mean(beside)),
    )


def played(checkpoint: Checkpoint, targets: str, out: Path, seed: int, *, wired: bool) -> list[Course]:
    """The session of each world; stored ones are read."""
    task = checkpoint.solver.task
    courses = []
    for target in targets_of(task, targets.split(",")):
        path = out / f"{task.name}-{target.name}-{seed}-{'true' if wired else 'shuffled'}.json"
        if not path.exists():
            place = source_in(target, checkpoint.solver, tables=not task.exact)
            one = kept_course(checkpoint, target.name, place.play, seed, wired=wired)
            path.write_text(json.dumps(asdict(one)))
        courses.append(Course(**json.loads(path.read_text())))
    return courses


def rows(forecast: TrialsForecast, courses: list[Course]) -> list[tuple[str, str, float, int, int]]:
    """(event, at most, predicted share, sessions in which it was true, sessions)."""
    lines = []
    for until, said, counts in (
        ("first success", forecast.first_success, [c.first_success for c in courses]),
        *(
            (f"gain of {one.difference:g} shown", one, [c.pairs for c in courses if is_near(c, one.difference)])
            for one in forecast.shown
        ),
    ):
        for share in (said.half, said.four_of_five):
            most = MOST_PAIRS if share.most is None else share.most
            held = sum(count is not None and count <= most for count in counts)
            lines.append((until, str(most), share.share, held, len(counts)))
    return list(dict.fromkeys(lines))


def is_near(one: Course, difference: float) -> bool:
    """Whether the row of the forecast for `difference` applies to the world."""
    low, high = NEAR[difference]
    return low <= one.gain < high


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--task", default="pendulum")
    parser.add_argument("--targets", default="drawn")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("build/forecasts"))
    asked = parser.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)
    checkpoint = load_checkpoint(get_task(asked.task), "default")
    forecast = load(checkpoint.path, checkpoint.sha256)
    if forecast is None:
        raise SystemExit(f"no forecast yet: adaptsim checkpoints trials --task {asked.task}")
    courses = played(checkpoint, asked.targets, asked.out, asked.seed, wired=True)
    print(f"{asked.task}, {asked.targets}: {len(courses)} worlds, one session each\n")
    print("| until | trials or pairs, at most | said | held |\n|---|---|---|---|")
    for until, most, share, held, count in rows(forecast, courses):
        print(f"| {until} | {most} | {share:.0%} | {held} of {count}{f' ({held / count:.0%})' if count else ''} |")
    for name, those in (
        ("true", courses),
        ("shuffled", played(checkpoint, asked.targets, asked.out, asked.seed, wired=False)),
    ):
        called = [one for one in those if Kind.UNINFORMED.value in one.kinds]
        varied = [one for one in those if 0.1 <= np.mean(np.array(one.rewards) > FAILED) <= 0.9]
        both = sum(one in called for one in varied)
        print(f"\n{name} outcomes: uninformed in {len(called)} of {len(those)}", end="; ")
        print(f"of the {len(varied)} where a tenth to nine tenths of the trials succeeded, in {both}")
        if name == "true" and called:
            print("  " + ", ".join(f"{one.world} (final {one.final:.2f}, UDR {one.udr:.2f})" for one in called))


if __name__ == "__main__":
    main()
