"""The output of `run-iteration --json`: one object per iteration. Pure."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from adaptsim_cli.errors import SessionError
from adaptsim_cli.session.keeping import about, size_bytes
from adaptsim_cli.session.records import DimensionRecord, Facts, ResultRecord, Row, Samples, TrialRecord
from adaptsim_cli.session.store import SessionStore
from sim.adaptation.method import Particle


def summary(
    facts: Facts, names: Sequence[str], before: Sequence[Particle], trials: Sequence[TrialRecord], result: ResultRecord
) -> dict[str, Any]:
    """The documented object; parameters by name, in units."""
    return {
        "task": facts.task,
        "session": facts.name,
        "iteration": result.iteration,
        "hw": facts.hw,
        "world": facts.world,
        "seed": facts.seed,
        "units": facts.units,
        "particles": [
            _particle(facts, names, particle, [t for t in trials if t.particle == index + 1], then)
            for index, (particle, then) in enumerate(zip(before, result.next_particles, strict=True))
        ],
        "best": result.best.model_dump(mode="json"),
        "verdict": result.verdict.model_dump(mode="json"),
        "outlook": None if result.outlook is None else result.outlook.model_dump(mode="json"),
        "timing_s": {key: round(value, 3) for key, value in result.timing_s.items()},
    }


def _particle(
    facts: Facts, names: Sequence[str], now: Particle, trials: Sequence[TrialRecord], then: Samples
) -> dict[str, Any]:
    return {
        "params": named(names, now.mean),
        "trials": [
            {
                "trial": trial.number,
                "context": by_name(facts.context, trial.context),
                "action": by_name(facts.action, trial.action),
                "reward": trial.reward,
                "outcome": trial.outcome.value,
                "observation": list(trial.observation),
            }
            for trial in trials
        ],
        "mean_reward": float(np.mean([trial.reward for trial in trials])),
        "next_params": named(names, np.mean(then, axis=0)),
    }


def named(names: Sequence[str], values: Row | np.ndarray[Any, np.dtype[np.float64]]) -> dict[str, float]:
    """Values by the names of their dimensions. Raises ValueError if the counts differ."""
    return dict(zip(names, (float(v) for v in values), strict=True))


def by_name(dimensions: Sequence[DimensionRecord], values: Row) -> dict[str, float]:
    """Values by the names of their quantities."""
    return {d.name: value for d, value in zip(dimensions, values, strict=True)}


def overview(store: SessionStore) -> dict[str, Any]:
    """One session in one line. Raises SessionError."""
    facts, iterations = store.facts, store.iterations()
    rewards = [trial.reward for i in range(iterations) for trial in store.trials(i)]
    results = [result for i in range(iterations) if (result := store.result(i)) is not None]
    last, said = (results[-1] if results else None), about(store.folder)
    return {
        **facts.named(),
        "created": facts.created,
        "iterations": len(results),
        "trials": len(rewards),
        "mean_reward": float(np.mean(rewards)) if rewards else None,
        "verdict": None if last is None else last.verdict.model_dump(mode="json"),
        "size_bytes": size_bytes(store.folder),
        "note": said.note,
        "tags": list(said.tags),
    }


def overview_or_damage(root: Path, name: str) -> dict[str, Any]:
    """One session in one line; a damaged one with its name and an error, so that the list still shows the others."""
    try:
        return overview(SessionStore.open(root, name))
    except SessionError as error:
        return {"session": name, "error": str(error)}


def details(store: SessionStore) -> dict[str, Any]:
    """One session with all its counting trials and results. Raises SessionError."""
    facts = store.facts
    trials = [trial for i in range(store.iterations()) for trial in store.trials(i)]
    results = [result for i in range(store.iterations()) if (result := store.result(i)) is not None]
    return {
        "facts": facts.model_dump(mode="json"),
        "folder": str(store.folder),
        "units": facts.units,
        "trials": [
            {
                "trial": t.number,
                "attempt": t.attempt,
                "iteration": t.iteration,
                "particle": t.particle,
                "reward": t.reward,
                "predicted_reward": t.predicted_reward,
                "outcome": t.outcome.value,
                "overruled_from": t.overruled_from.value if t.overruled_from else None,
                "context": by_name(facts.context, t.context),
                "action": by_name(facts.action, t.action),
                "timing_s": t.timing_s,
            }
            for t in trials
        ],
        "rejected": [
            {"trial": one.key.number, "attempt": one.key.attempt + 1, "at": one.note.at, "reason": one.note.text}
            for one in store.rejections()
        ],
        "results": [
            {
                "iteration": r.iteration,
                "best": r.best.model_dump(mode="json"),
                "verdict": r.verdict.model_dump(mode="json"),
                "timing_s": r.timing_s,
            }
            for r in results
        ],
    }
