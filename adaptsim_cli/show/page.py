"""Writes a session, or a rollout, as one self-contained HTML page."""

from __future__ import annotations

import base64
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from adaptsim_cli.screen.html import fill
from adaptsim_cli.screen.outputs.learning import Revealed
from adaptsim_cli.screen.outputs.trials import ForecastRecord
from adaptsim_cli.screen.views import predicted_between, quantity, sampled_in_words, value_in_words
from adaptsim_cli.session.advice import (
    best_in_words,
    check_first,
    compared_in_words,
    control_name,
    gain_in_words,
    in_words,
)
from adaptsim_cli.session.control import compared, is_hidden, pairs_of
from adaptsim_cli.session.folders import FILM, OVERLAY, REPORT
from adaptsim_cli.session.history import means_of, particles_of
from adaptsim_cli.session.judgement import Judgement, MeanReward, mean_of, trial_std
from adaptsim_cli.session.records import DimensionRecord, KeyMoment, ResultRecord, SessionFacts, TrialRecord
from adaptsim_cli.session.store import Change, SessionStore
from adaptsim_cli.show import figures, truth_view
from adaptsim_cli.show.agreement import agreement
from adaptsim_cli.show.figures import NARROW, WIDE, Level
from adaptsim_cli.show.truth_view import UdrReward
from adaptsim_cli.storage import durable
from hw.types import Array
from sim.adaptation.method import FAILED
from sim.adaptation.stages import Role
from sim.tasks import known_task
from sim.types import Dimension

NO_BREAK = "\N{NO-BREAK SPACE}"
_FIRST, _ADAPTED, _UDR = "c3", "c2", "c4"  # colours that no figure of two particles uses


@dataclass(frozen=True)
class Pictures:
    """The pictures of one trial on the page."""

    strip: tuple[tuple[KeyMoment, str], ...]  # each key frame, and its data URL
    film: str  # data URL of the sheet, "" without a camera
    over_film: str  # the figure over it, "" without a prediction
    overlay: str  # data URL, "" if there is none
    prediction: str = ""  # the figure, "" without a prediction


@dataclass(frozen=True)
class IterationView:
    """One iteration for the page; `result` is None while it runs."""

    number: int  # from 1
    particles: tuple[tuple[str, str], ...]  # (parameters, next parameters) of each
    trials: tuple[TrialRecord, ...]  # the newest first
    rejected: tuple[str, ...]
    result: ResultRecord | None

    @property
    def mean(self) -> float:
        """Mean reward of its trials."""
        return float(np.mean([trial.reward for trial in self.trials if trial.role is not Role.CONTROL]))


@dataclass(frozen=True)
class Reference:
    """A session of uniform domain randomisation in the same world."""

    session: str
    rewards: tuple[float, ...]


def write(
    store: SessionStore,
    out: Path | None = None,
    judgement: Judgement | str = "",
    reference: Reference | None = None,
    confirmed: Sequence[float] = (),
    truth: Revealed | None = None,
) -> Path:
    """Write the page (default: `report.html` in the session's folder) and return its path. Raises SessionError.

    `judgement` is the simulator's judgement in hindsight, or the reason why it is missing; `confirmed` are the rewards
    of trials that the best policy of the session has made since; `truth` has the hidden values of a simulated world.
    """
    path = out if out is not None else store.folder / REPORT
    durable.make_folder(path.absolute().parent)
    durable.replace_file(path.absolute(), render(store, judgement, reference, confirmed, truth).encode())
    return path


def render(
    store: SessionStore,
    judgement: Judgement | str = "",
    reference: Reference | None = None,
    confirmed: Sequence[float] = (),
    truth: Revealed | None = None,
) -> str:
    """The page as HTML. Raises SessionError if a record is corrupt."""
    facts, assessment = store.facts, None if isinstance(judgement, str) else judgement
    rejected = store.rejections()
    public = [i for i in range(store.iterations()) if not is_hidden(store, i)]
    views = tuple(view for i in public if (view := _iteration(store, i, rejected)).trials)
    played = sorted((trial for view in views for trial in view.trials), key=lambda trial: trial.trial)
    trials = [trial for trial in played if trial.role is not Role.CONTROL]
    results = [view.result for view in views if view.result is not None]
    newest = trials[-1].iteration if trials else 1
    curves = facts.curves.items() if trials else ()
    complete = [view.mean for view in views if view.result is not None]
    rows = levels(facts, trials, results, reference, confirmed, truth)
    simulated = simulator_levels(assessment)
    of_udr = _udr(facts, reference, truth)
    return fill(
        "show/page.html.j2",
        facts=facts,
        title=facts.title[:1].upper() + facts.title[1:],
        iterations=views,
        pictures={trial.trial: _pictures(store, trial, assessment) for trial in played},
        context_of=lambda trial: _quantities(_described(facts, facts.context), tuple(trial.context.values())),
        action_of=lambda trial: _quantities(_described(facts, facts.action), tuple(trial.action.values())),
        trials=trials,
        latest=results[-1] if results else None,
        verdict=in_words(
            results[-1].verdict, facts.object_name, facts.recorded, check_first(facts.task, facts.hw, facts.calibration)
        )
        if results
        else "",
        gain="" if not complete else f"{gain_in_words(complete)}{f'; {of_udr.in_words}' if of_udr else ''}.",
        complete=complete,
        udr=of_udr,
        best=best_in_words(results[-1].best, parameters_in_words(facts, results[-1].best.params), confirmed)
        if results
        else "",
        correction=_correction(facts, results[-1].outlook) if results else "",
        failed=FAILED,
        rewarded_trials=sum(t.is_rewarded for t in trials),
        figure_levels=both(lambda width: figures.levels(rows, width)) if rows else "",
        figure_simulator=both(lambda width: figures.levels(simulated, width)) if simulated else "",
        figure_rewards=both(
            lambda w: figures.rewards(trials, len(views), facts.layout, w, None if of_udr is None else of_udr.reward)
        )
        if trials
        else "",
        figure_parameters=[
            (d, figures.parameter(record, paths, assessment.posteriors if assessment else (), index, d.kinds))
            for index, (d, record, paths) in enumerate(
                zip(_described(facts, facts.parameters), facts.parameters, means_of(store, results).T, strict=True)
            )
        ],
        known=assessment,
        truth=None if truth is None else truth_view.in_words(truth),
        misses="" if truth is None else truth_view.misses_in_words(truth),
        truths=[] if truth is None else [(truth_view.row(one), figures.truth(one)) for one in truth.parameters],
        agreement=agreement(
            trials,
            assessment.predictions if assessment else None,
            assessment.unit if assessment else "",
            trial_std(facts.task),
        ),
        measured_udr=reference is not None,
        waivers=sorted({(w.safeguard, w.reason, w.by, w.on, w.until) for rig in store.rigs() for w in rig.waivers}),
        predicted_between=predicted_between,
        pairs=pairs_of(facts, played),
        control=control_name(facts.control),
        hidden=len(public) < store.iterations(),
        compared="" if (comparison := compared(facts, played)) is None else compared_in_words(comparison),
        unknown=judgement if isinstance(judgement, str) else "",
        quantities=[
            (title, space)
            for title, records in (
                ("Simulation parameters", facts.parameters),
                ("Context: what the policy sees before a trial", facts.context),
                ("Action: what it chooses", facts.action),
            )
            if (space := _described(facts, records))
        ],
        goals=any(trial.goal_m is not None for trial in trials),
        figure_table=both(lambda w: figures.table_view(trials, facts.context, newest, w))
        if trials and not facts.curves
        else "",
        figure_curves=[(label, both(_curve(trials, label, column, newest))) for label, column in curves],
        kinds=_kinds(results),
    )


def both(draw: Callable[[float], str]) -> str:
    """A figure for wide and for narrow pages; the style shows the one that fits."""
    return f'<div class="wide">{draw(WIDE)}</div><div class="narrow">{draw(NARROW)}</div>'


def _udr(facts: SessionFacts, reference: Reference | None, truth: Revealed | None) -> UdrReward | None:
    """The reward of UDR, by the truth of a simulated world or as a session measured it; None if it is not known."""
    if facts.method == "udr":
        return None
    if truth is not None:
        return UdrReward.true(truth)
    if reference is None:
        return None
    count = f"{len(reference.rewards)} trial{'s' * (len(reference.rewards) != 1)}"
    return UdrReward(float(np.mean(reference.rewards)), f"{count} of session {reference.session}", "here")


def levels(
    facts: SessionFacts,
    trials: Sequence[TrialRecord],
    results: Sequence[ResultRecord],
    reference: Reference | None,
    confirmed: Sequence[float],
    truth: Revealed | None,
) -> tuple[Level, ...]:
    """Rewards of the first policies, the best policy and UDR: first the measured ones, then the predicted one."""
    if not trials:
        return ()
    std = trial_std(facts.task)
    first = mean_of([t.reward for t in trials if t.iteration == 1], std)
    rows = [_measured("First policies", first, "in iteration 1", _FIRST)]
    if len(results) > 1:
        newest = mean_of([t.reward for t in trials if t.iteration == len(results)], std)
        rows.append(_measured("Last policies", newest, f"in iteration {len(results)}", _ADAPTED))
    if results and (tried := results[-1].best.tried):
        repeated = mean_of([t.reward for t in trials if t.trial in tried], std)
        rows.append(_measured("Best policy", repeated, "that it would repeat", _ADAPTED))
    if confirmed:
        rows.append(_measured("Best policy", mean_of(confirmed, std), "after the session", _ADAPTED))
    if reference is not None:
        rows.append(_measured("UDR", mean_of(reference.rewards, std), f"in session {reference.session}", _UDR))
    if truth is not None and facts.method != "udr":
        of_udr = UdrReward.true(truth)
        rows.append(Level("UDR", "simulated truth", of_udr.source, of_udr.reward, of_udr.reward, of_udr.reward, _UDR))
    if results:
        best = results[-1].best
        kind = "estimated" if results[-1].outlook is None else "predicted"
        detail = f"{kind} from {best.trials} trial{'s' * (best.trials != 1)}"
        detail += ", not yet tried" if best.tried == () and not confirmed else ""
        rows.append(Level("Best policy", kind, detail, best.mean_reward, *best.ci95, _ADAPTED, is_open=True))
    return tuple(rows)


def simulator_levels(judgement: Judgement | None) -> tuple[Level, ...]:
    """The rewards that the simulator predicts for likely parameters, without using the rewards of the trials."""
    if judgement is None:
        return ()
    rows = (
        ("First policies", judgement.first, _FIRST),
        ("Best policy", judgement.adapted, _ADAPTED),
        ("UDR", judgement.udr, _UDR),
    )
    detail = "predicted by the simulator alone"
    return tuple(
        Level(label, "simulator", detail, earned.mean, earned.low, earned.high, colour, is_open=True)
        for label, earned, colour in rows
        if earned is not None
    )


def _measured(label: str, measurement: MeanReward, detail: str, colour: str) -> Level:
    text = f"{measurement.trials} trial{'s' * (measurement.trials != 1)} {detail}"
    return Level(label, "measured", text, measurement.mean, measurement.low, measurement.high, colour)


def _curve(trials: Sequence[TrialRecord], label: str, column: int, newest: int) -> Callable[[float], str]:
    return lambda width: figures.curve_view(trials, label, column, newest, width)


def _iteration(store: SessionStore, iteration: int, rejections: Sequence[Change]) -> IterationView:
    parameters, result = _described(store.facts, store.facts.parameters), store.result(iteration)
    now = [_sampled(parameters, particle.samples) for particle in particles_of(store, iteration)]
    then = [_sampled(parameters, np.array(samples)) for samples in result.next_particles] if result else []
    pairs = tuple(zip(now, then or [""] * len(now), strict=True))
    trials = tuple(reversed(store.played(iteration)))
    rejected = tuple(
        f"Trial {one.key.number}, attempt {one.key.attempt + 1}: {one.note.text}"
        for one in rejections
        if store.iteration_of(one.key.number) == iteration
    )
    return IterationView(iteration + 1, pairs, trials, rejected, result)


def _pictures(store: SessionStore, record: TrialRecord, judgement: Judgement | None) -> Pictures:
    folder = store.trial_folder(*record.position)
    strip = tuple((moment, picture(folder / moment.file)) for moment in record.moments)
    overlay = picture(folder / OVERLAY) if OVERLAY in record.files else ""
    curves = tuple(store.facts.curves)
    expected = judgement.predictions.get(record.trial) if judgement else None  # None: a control trial
    drawn = figures.prediction(record, expected, curves) if expected else ""
    film = picture(folder / FILM) if FILM in record.files else ""
    over = figures.over_film(record, expected) if expected and not curves else ""
    return Pictures(strip, film, over, overlay, drawn)


def _kinds(results: Sequence[ResultRecord]) -> tuple[str, ...]:
    """The stages of the times, the total last."""
    kinds = dict.fromkeys(kind for result in results for kind in result.timing_s)
    return (*(kind for kind in kinds if kind != "total"), *(kind for kind in kinds if kind == "total"))


def _quantities(dimensions: Sequence[Dimension], values: Iterable[float]) -> str:
    """Plain name, value and unit of each quantity, without a line break inside one."""
    each = (f"{d.plain_name} {value_in_words(d, v)}" for d, v in zip(dimensions, values, strict=True))
    return ", ".join(text.replace(" ", NO_BREAK) for text in each)


def _sampled(dimensions: Sequence[Dimension], samples: Array) -> str:
    """Plain name and mean of each quantity over samples (m, n), or the share of each word of a category."""
    each = (f"{d.plain_name} {sampled_in_words(d, column)}" for d, column in zip(dimensions, samples.T, strict=True))
    return ", ".join(text.replace(" ", NO_BREAK) for text in each)


def _described(facts: SessionFacts, records: tuple[DimensionRecord, ...]) -> tuple[Dimension, ...]:
    """The stored dimensions, with plain names and meanings if the task is known."""
    task = known_task(facts.task)
    spaces = (task.parameters, task.context, task.action) if task is not None else ()
    dimensions = {(d.name, d.unit): d for space in spaces for d in space.dimensions}
    return tuple(
        replace(dimensions.get((r.name, r.unit), bare), low=r.low, high=r.high, scale=r.scale)
        for r in records
        for bare in (Dimension(r.name, r.unit, r.low, r.high, words=r.words),)
    )


def _correction(facts: SessionFacts, forecast: ForecastRecord | None) -> str:
    """The correction of the simulator's action, in words."""
    if forecast is None:
        return ""
    terms = forecast.noticeable(_described(facts, facts.action))
    signed = [f"{d.plain_name} {'+' if off > 0 else '−'}{quantity(abs(off), d.unit)}" for d, off in terms]
    return ", ".join(text.replace(" ", NO_BREAK) for text in signed) or "none"


def parameters_in_words(facts: SessionFacts, params: Mapping[str, float]) -> str:
    """Plain name, value and unit of each parameter."""
    return _quantities(_described(facts, facts.parameters), tuple(params[d.name] for d in facts.parameters))


def picture(path: Path) -> str:
    """A JPEG as a data URL."""
    return "data:image/jpeg;base64," + base64.b64encode(path.read_bytes()).decode()
