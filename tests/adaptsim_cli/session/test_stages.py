from __future__ import annotations

import numpy as np
import pytest

from adaptsim_cli.session.records import Adapt, Draw, Existing, RunTrial, Show, TrialKey, generator, next_stage

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


def test_a_new_session_begins_with_its_first_trial() -> None:
    assert next_stage(NOTHING, 2, 2) == RunTrial(0, 0, 0, TrialKey(1, 0), interrupted=False)


def test_trials_go_particle_by_particle() -> None:
    stage = next_stage(existing([(1, 0), (2, 0)]), 2, 2)
    assert stage == RunTrial(0, 1, 0, TrialKey(3, 0), interrupted=False)


def test_a_motion_that_started_and_never_completed_is_interrupted() -> None:
    stage = next_stage(existing([(1, 0)], started=((1, 0), (2, 0))), 2, 2)
    assert stage == RunTrial(0, 0, 1, TrialKey(2, 0), interrupted=True)


def test_a_motion_that_is_stored_waits_for_its_review() -> None:
    stage = next_stage(existing([(1, 0)], started=((1, 0), (2, 0)), recorded=((2, 0),)), 2, 2)
    assert stage == RunTrial(0, 0, 1, TrialKey(2, 0), interrupted=False, recorded=True)
    rejected = next_stage(existing([(1, 0)], started=((2, 0),), recorded=((2, 0),), rejected=((2, 0),)), 2, 2)
    assert rejected == RunTrial(0, 0, 1, TrialKey(2, 1), interrupted=False, recorded=False)


def test_a_rejected_trial_is_done_again_under_the_next_attempt() -> None:
    stage = next_stage(existing([(1, 0)], started=((1, 0),), rejected=((1, 0), (1, 1))), 2, 2)
    assert stage == RunTrial(0, 0, 0, TrialKey(1, 2), interrupted=False)


def test_all_trials_lead_to_adaptation_then_to_showing_then_to_the_next_iteration() -> None:
    done = [(1, 0), (2, 0)]
    keys = (TrialKey(1, 0), TrialKey(2, 0))
    assert next_stage(existing(done), 1, 2) == Adapt(0, keys)
    assert next_stage(existing(done, results={0: done}), 1, 2) == Show(0)
    assert next_stage(existing(done, results={0: done}, shown=(0,)), 1, 2) == RunTrial(1, 0, 0, TrialKey(3, 0), False)


def test_redoing_a_trial_makes_the_result_that_rests_on_it_obsolete() -> None:
    before = [(1, 0), (2, 0)]
    redone = existing([*before, (2, 1)], rejected=((2, 0),), results={0: before}, shown=(0,))
    assert next_stage(redone, 1, 2) == Adapt(0, (TrialKey(1, 0), TrialKey(2, 1)))


@pytest.mark.parametrize("other", [{"seed": 4}, {"iteration": 2}, {"particle": 1}, {"trial": 1}, {"attempt": 1}])
def test_every_coordinate_of_a_step_changes_its_random_numbers(other: dict[str, int]) -> None:
    base = {"seed": 3, "iteration": 1, "particle": 0, "trial": 0, "attempt": 0}
    draw = lambda **at: generator(at.pop("seed"), Draw.CONTEXT, **at).random(4)  # noqa: E731
    assert np.array_equal(draw(**base), draw(**base))
    assert not np.array_equal(draw(**base), draw(**(base | other)))
    assert not np.array_equal(draw(**base), generator(3, Draw.NEXT, 1).random(4))
