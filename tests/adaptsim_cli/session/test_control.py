"""Control trials: in the same places, in random order, hidden from the operator and from what learns."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from real_lab import quiet, said
from toy_rig import PARAMETERS, TASK, ToyLab, ToyPolicy, opener, toy_parts
from toy_session import ScriptedOperator, resolved, silent, summary

from adaptsim_cli.errors import Interrupted, SessionError, UsageError
from adaptsim_cli.session import beginning, records, running, terminal_views
from adaptsim_cli.session.advice import compared_in_words
from adaptsim_cli.session.control import ControlPolicy, compared, pairs_of, planned_pairs, power_in_words
from adaptsim_cli.session.correcting import amend, amendable, redo
from adaptsim_cli.session.exporting import rows
from adaptsim_cli.session.flow import RunningSession, run_iteration
from adaptsim_cli.session.history import history_of, played_of, trials_of
from adaptsim_cli.session.keeping import verify
from adaptsim_cli.session.records import MotionRecord, SessionFacts
from adaptsim_cli.session.store import SessionStore
from adaptsim_cli.session.watching import AllOf, SessionLog
from adaptsim_cli.show import page
from adaptsim_cli.show.live_state import so_far, trial_shown
from perception.types import Outcome
from sim.adaptation.method import Particle
from sim.adaptation.stages import Layout

NAME = "toy-wd-control-udr"


def controls() -> tuple[ControlPolicy, ...]:
    """Two policies that push far too little: they earn nothing."""
    mean = PARAMETERS.middle
    return tuple(ControlPolicy(ToyPolicy(Particle(mean[None]), noise), mean) for noise in (-9.0, -8.0))


def begun(home, operator=None, lab=None) -> RunningSession:
    settings = resolved(home, control="udr")
    parts, root = toy_parts(lab or ToyLab(0), control=controls), settings.places.sessions
    store = (
        SessionStore.open(root, NAME) if (root / NAME).is_dir() else beginning.begin(root, NAME, settings.config, parts)
    )
    return RunningSession(store, parts, operator or ScriptedOperator(), silent())


def played(session: RunningSession, iterations: int) -> RunningSession:
    for _ in range(iterations):
        shown = run_iteration(session)
        session.store.mark_shown(shown.iteration - 1, "now")
    return session


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> RunningSession:
    return played(begun(tmp_path_factory.mktemp("whole")), 3)


def test_control_trials_begin_where_policies_have_learnt_and_share_the_drawn_places(whole):
    store = whole.store
    assert [trial.role for trial in store.played(0)] == ["alone"] * 4
    for iteration in (1, 2):
        roles = [trial.role for trial in store.played(iteration)]
        assert sorted(roles[:4]) == sorted(roles[4:]) == ["control", "control", "own", "own"], "a block for a particle"
    assert [trial.trial for trial in played_of(store)] == list(range(1, 21))
    pairs = pairs_of(store.facts, played_of(store))
    assert len(pairs) == 8
    assert all(own.drawn_context == other.drawn_context for own, other in pairs)
    assert len({tuple(own.drawn_context.values()) for own, _ in pairs}) == 8


def test_nothing_is_learnt_from_control_trials(whole, tmp_path):
    plain = resolved(tmp_path)
    parts = toy_parts(ToyLab(0))
    other = RunningSession(
        beginning.begin(plain.places.sessions, "p", plain.config, parts), parts, ScriptedOperator(), silent()
    )
    run_iteration(other)
    assert whole.store.result(0).next_particles == other.store.result(0).next_particles
    history = history_of(TASK, whole.store, 2)
    assert [len(seen.trials) for iteration in history for seen in iteration] == [2] * 6
    assert min(trial.reward for trial in trials_of(whole.store)) > 0.0
    assert max(t.reward for t in played_of(whole.store) if t.role == "control") == 0.0
    best = whole.store.result(2).best.tried
    assert best is not None and {t.role for t in played_of(whole.store) if t.trial in best} <= {"alone", "own"}


def test_the_result_says_what_the_pairs_show(whole):
    first, second = (whole.store.result(i).control for i in (1, 2))
    assert whole.store.result(0).control is None
    assert (first.pairs, second.pairs) == (4, 8)
    assert second.control_reward == 0.0 and second.difference == second.mean_reward > 0.3
    assert second.ci95[0] <= second.difference <= second.ci95[1]
    assert compared_in_words(second).startswith(f"Adapted {second.mean_reward:.2f}, UDR 0.00, difference +")
    assert summary(whole.store, 2)["control"]["pairs"] == 8
    shown = page.render(whole.store)
    assert "Does adapting help here?" in shown and compared_in_words(second) in shown
    assert shown.count("<small>control trial by UDR") == 8
    assert [row["role"] for row in rows(whole.store)].count("control") == 8


def test_the_order_differs_from_block_to_block_and_from_seed_to_seed():
    def orders(seed: int) -> Iterator[tuple[str, ...]]:
        layout = Layout(2, 2, controlled_from=1, seed=seed)
        for iteration in range(1, 40):
            roles = [slot.role for slot in layout.slots(iteration)]
            yield from (tuple(roles[:4]), tuple(roles[4:]))

    assert len(set(orders(0))) == 6, "every order of two and two"
    assert list(orders(0)) != list(orders(1))
    firsts = [order[0] for seed in range(20) for order in orders(seed)]
    assert 0.45 < firsts.count("control") / len(firsts) < 0.55


def test_numbers_and_iterations_of_a_layout_agree():
    layout = Layout(2, 2, controlled_from=1)
    assert [layout.numbers(i) for i in range(3)] == [range(1, 5), range(5, 13), range(13, 21)]
    assert [layout.iteration_of(n) for n in (1, 4, 5, 12, 13, 20)] == [0, 0, 1, 1, 2, 2]
    assert Layout(2, 2).numbers(2) == range(9, 13)


def test_a_real_arm_draws_an_order_that_nobody_knows(tmp_path):
    settings = resolved(tmp_path, control="udr").config
    simulated = [beginning.facts_for("s", settings, toy_parts(ToyLab(0))).control_seed for _ in range(2)]
    real = settings.model_copy(update={"hw": "panda"})
    drawn = {beginning.facts_for("s", real, toy_parts(ToyLab(0))).control_seed for _ in range(3)}
    assert simulated == [0, 0] and len(drawn) == 3


def test_while_an_iteration_runs_nothing_shown_depends_on_whose_policy_acts(tmp_path):
    session = played(begun(tmp_path), 1)
    screen, proposals = quiet(), list[MotionRecord]()
    log = SessionLog(session.store.folder, screen)

    def stop(made: MotionRecord) -> None:
        proposals.append(made)
        if made.trial == 9:
            raise Interrupted("stop")

    operator = ScriptedOperator(before_motion=stop)

    again = RunningSession(session.store, session.parts, operator, screen, AllOf(log))
    with pytest.raises(Interrupted):
        run_iteration(again)
    roles = [made.role for made in proposals]
    assert set(roles) == {"own", "control"}
    views = [trial_shown(TASK, 2, made, "") for made in proposals]
    assert {(str(v["parameters"]), v["expected"]) for v in views} == {("[]", None)}
    heads = said(screen)
    assert "expected" not in heads.lower() and "was trained for" not in heads
    assert heads.count("stays hidden until the iteration is complete") == 5
    state = so_far(session.store, TASK, None)
    assert [r["number"] for r in state["rewards"]] == list(range(1, 9)), "each trial shows, whoever made it"
    assert {(r["expected"], r["control"]) for r in state["rewards"][4:]} == {(None, False)}
    logged = (session.store.folder / "log.jsonl").read_text()
    assert logged.count('"planned"') == 5
    assert "predicted" not in logged and "control" not in logged.replace("control trials", "") and '"own"' not in logged
    shown = page.render(session.store)
    assert "until it is complete" in shown and "Trial 6" not in shown
    for trial in session.store.played(1):
        assert "expected" not in screen_of(terminal_views.tracked(trial))


def screen_of(view) -> str:
    screen = quiet()
    screen.show(view)
    return said(screen)


@pytest.mark.parametrize("killed_at", [5, 8, *(pytest.param(n, marks=pytest.mark.long) for n in (6, 7, 9, 10, 11, 12))])
def test_killed_anywhere_it_goes_on_with_the_same_trials(tmp_path, whole, killed_at):
    def kill(trial: int, attempt: int) -> None:
        if trial == killed_at:
            raise KeyboardInterrupt

    lab = ToyLab(0, hooks={"stop_recording": kill})
    session = played(begun(tmp_path), 1)
    session = begun(tmp_path, lab=lab)
    with pytest.raises((KeyboardInterrupt, Interrupted)):
        run_iteration(session)
    run_iteration(begun(tmp_path))
    store = SessionStore.open(session.store.folder.parent, NAME)
    assert [t.role for t in store.played(1)] == [t.role for t in whole.store.played(1)]
    assert store.result(1).control.pairs == 4
    assert verify(store.folder.parent, NAME).damage == ()


def test_a_control_trial_is_redone_and_amended_like_any_other(tmp_path):
    session = played(begun(tmp_path), 2)
    store = session.store
    number = next(t.trial for t in store.played(1) if t.role == "control")
    before = store.result(1).control
    _, choices = amendable(store, TASK, (Outcome.ON_BLADE, Outcome.ON_TABLE), number)
    # the toy's failed track has no end on the blade, so its outcomes earn nothing
    assert choices[Outcome.ON_TABLE] == 0.0
    assert redo(store, number, "the piece was touched") == 2
    lab = ToyLab(0)
    run_iteration(begun(tmp_path, lab=lab))
    store = SessionStore.open(store.folder.parent, NAME)
    assert lab.executions == [(number, 1)]
    assert [t.attempt for t in store.played(1) if t.trial == number] == [2]
    assert store.result(1).next_particles == session.store.result(1).next_particles, "nothing learnt from it"
    assert store.result(1).control.pairs == before.pairs == 4
    own = next(t.trial for t in store.played(1) if t.role == "own")
    amend(store, TASK, own, Outcome.LOST, 0.0, "seen")
    run_iteration(begun(tmp_path))
    after = SessionStore.open(store.folder.parent, NAME).result(1).control
    assert after.mean_reward < before.mean_reward


@pytest.mark.long
def test_the_cost_is_said_before_and_nothing_is_promised_that_has_not_begun(tmp_path):
    home, screen = tmp_path, quiet()
    settings = resolved(home, control="udr")

    def go(iterations: int) -> str:
        screen = quiet()
        request = running.SessionRequest(None, frozenset({"task", "control"}), iterations, yes=True)
        running.run_session(settings, request, opener(ToyLab(0), control=controls), page.write, screen)
        return said(screen)

    assert "begin with iteration 2" in go(1)
    second = go(2)
    assert "Control by udr: 8 more trials" in second
    assert "difference +" in second and "valid at any time" in second
    assert screen is not None


def test_a_session_with_control_is_of_a_format_that_older_programs_refuse(whole, tmp_path):
    assert whole.store.facts.format == records.WITH_CONTROL > records.FORMAT
    plain = beginning.facts_for("s", resolved(tmp_path).config, toy_parts(ToyLab(0)))
    assert (plain.format, plain.control, plain.control_seed) == (records.FORMAT, "", 0)
    assert plain.layout == Layout(2, 2)
    path = tmp_path / "session.toml"
    path.write_bytes(records.to_toml(whole.store.facts.model_copy(update={"format": 6})))
    with pytest.raises(SessionError, match="Update adaptsim"):
        records.read(SessionFacts, path)


def test_a_session_cannot_be_continued_with_another_control(tmp_path):
    played(begun(tmp_path), 1)
    settings = resolved(tmp_path, control="random")
    request = running.SessionRequest(NAME, frozenset({"control"}), 1, yes=True)
    with pytest.raises(UsageError, match="begun with control = udr, not random"):
        running.run_session(settings, request, opener(ToyLab(0), control=controls), page.write, quiet())


def test_without_a_pair_there_is_nothing_to_compare(whole):
    assert compared(whole.store.facts, whole.store.played(0)) is None
    own = [trial for trial in played_of(whole.store) if trial.role == "own"]
    assert compared(whole.store.facts, own) is None
    assert np.isclose(compared(whole.store.facts, played_of(whole.store)).mean_reward, np.mean([t.reward for t in own]))


def test_a_session_says_before_its_first_trial_which_gain_its_pairs_can_show(tmp_path):
    store = begun(tmp_path).store
    assert planned_pairs(store.facts) == 16, "four iterations with two particles and two trials"
    said = power_in_words(store.facts)
    assert said.startswith("The 16 planned pairs show a gain of 0.2 in ") and "--pairs 60" in said
    planned = store.facts.model_copy(update={"pairs": 60})
    assert "The 60 planned pairs show a gain of 0.2 in 8" in power_in_words(planned)
    assert "--pairs" not in power_in_words(planned)
