from __future__ import annotations

import pytest

from sim.adaptation.stages import Adapt, Existing, Layout, RunTrial, Show, TrialKey, next_stage

NOTHING = Existing(frozenset(), frozenset(), frozenset(), frozenset(), {}, frozenset())


def existing(
    completed: list[tuple[int, int]],
    started: tuple[tuple[int, int], ...] = (),
    rejected: tuple[tuple[int, int], ...] = (),
    results: dict[int, list[tuple[int, int]]] | None = None,
    shown: tuple[int, ...] = (),
    recorded: tuple[tuple[int, int], ...] = (),
) -> Existing:
    def keys(pairs: object) -> tuple[TrialKey, ...]:
        return tuple(TrialKey(*pair) for pair in pairs)  # type: ignore[attr-defined]

    return Existing(
        frozenset(keys(completed)),
        frozenset(keys(started)),
        frozenset(keys(recorded)),
        frozenset(keys(rejected)),
        {i: keys(r) for i, r in (results or {}).items()},
        frozenset(shown),
    )


@pytest.mark.parametrize(
    ("found", "stage"),
    [
        pytest.param(NOTHING, RunTrial(0, 0, 0, TrialKey(1, 0)), id="a new session begins with its first trial"),
        pytest.param(existing([(1, 0), (2, 0)]), RunTrial(0, 1, 0, TrialKey(3, 0)), id="particle by particle"),
        pytest.param(
            existing([(1, 0)], started=((1, 0), (2, 0))),
            RunTrial(0, 0, 1, TrialKey(2, 0), interrupted=True),
            id="started and never completed",
        ),
        pytest.param(
            existing([(1, 0)], started=((1, 0), (2, 0)), recorded=((2, 0),)),
            RunTrial(0, 0, 1, TrialKey(2, 0), recorded=True),
            id="a stored motion waits for its review",
        ),
        pytest.param(
            existing([(1, 0)], started=((2, 0),), recorded=((2, 0),), rejected=((2, 0),)),
            RunTrial(0, 0, 1, TrialKey(2, 1)),
            id="a rejected recording",
        ),
        pytest.param(
            existing([(1, 0)], started=((1, 0),), rejected=((1, 0), (1, 1))),
            RunTrial(0, 0, 0, TrialKey(1, 2)),
            id="a rejected trial is done again under the next attempt",
        ),
    ],
)
def test_the_next_stage_is_the_first_trial_that_is_missing(found: Existing, stage: RunTrial) -> None:
    assert next_stage(found, Layout(2, 2)) == stage


def test_all_trials_lead_to_adaptation_then_to_showing_then_to_the_next_iteration() -> None:
    done = [(1, 0), (2, 0)]
    keys = (TrialKey(1, 0), TrialKey(2, 0))
    assert next_stage(existing(done), Layout(1, 2)) == Adapt(0, keys)
    assert next_stage(existing(done, results={0: done}), Layout(1, 2)) == Show(0)
    assert next_stage(existing(done, results={0: done}, shown=(0,)), Layout(1, 2)) == RunTrial(
        1, 0, 0, TrialKey(3, 0), False
    )


def test_redoing_a_trial_makes_the_result_that_rests_on_it_obsolete() -> None:
    before = [(1, 0), (2, 0)]
    redone = existing([*before, (2, 1)], rejected=((2, 0),), results={0: before}, shown=(0,))
    assert next_stage(redone, Layout(1, 2)) == Adapt(0, (TrialKey(1, 0), TrialKey(2, 1)))
