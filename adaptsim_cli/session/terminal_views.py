"""Everything that a session prints for a person, as rich renderables."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from rich import box
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from adaptsim_cli.screen import quantities, views
from adaptsim_cli.screen.outputs.sessions import Amended, Damaged, SessionRow, SessionShown, Verified
from adaptsim_cli.screen.reply import Reply
from adaptsim_cli.session.advice import (
    HEADLINES,
    best_in_words,
    check_first,
    compared_in_words,
    in_words,
)
from adaptsim_cli.session.records import ROLLOUT, MotionRecord, ResultRecord, SessionFacts, TrialRecord
from hw.types import Array
from sim.adaptation.stages import Role, RunTrial
from sim.types import Dimension, Space

if TYPE_CHECKING:
    from sim.adaptation.method import Particle
    from sim.adaptation.trials_forecast import TrialsForecast
    from sim.tasks.task import Task


def session_header(task: Task, facts: SessionFacts, iteration: int, hardware: str, *, is_new: bool) -> RenderableType:
    """The heading of an iteration: hardware, task, number and session. In a new session, it explains the quantities
    too.
    """
    where = f"iteration {iteration + 1} of session {facts.name}"
    legend = (views.indent(quantities.meanings(task, with_symbols=False)),) if is_new else ()
    return Group(
        views.badge(views.RECORDED if facts.recorded else facts.hw, hardware),
        Text(task.title[:1].upper() + task.title[1:], style="bold"),
        Text(where),
        *legend,
    )


def trial(task: Task, facts: SessionFacts, stage: RunTrial, particle: Particle, left_s: float) -> RenderableType:
    """The heading of a trial: number, attempt, particle, and the time left in its iteration (0: unknown)."""
    again = f", attempt {stage.key.attempt + 1}" if stage.key.attempt else ""
    place = _place(facts, stage)
    left = f", about {left_s / 60.0:.0f} min left" if left_s >= 60.0 else ""
    head = Text.assemble(
        views.mark(views.RECORDED if facts.recorded else facts.hw),
        (f" Trial {stage.key.number}", "bold"),
        f"{again}   {place}{left}",
    )
    if stage.role is not Role.ALONE:
        blind = (
            "The session's own policy acts, or the control's; which one stays hidden until the iteration is complete"
        )
        return Group(Text(""), head, views.indent(Text(blind, style="dim")))
    why = (
        f"The task policy was trained for {views.sampled(task.parameters, particle.samples)}"
        if len(particle.samples) == 1
        else f"The task policy was trained for {len(particle.samples)} parameter sets over their ranges, "
        f"mean {views.sampled(task.parameters, particle.samples)}"
    )
    return Group(Text(""), head, views.indent(Text(why, style="dim")))


def _place(facts: SessionFacts, stage: RunTrial) -> str:
    """The place of a trial in its iteration, and its particle; a rollout adapts nothing, so it has neither."""
    numbers = facts.layout.numbers(stage.iteration)
    counted = f"{stage.key.number - numbers.start + 1} of {len(numbers)}"
    if facts.method == ROLLOUT:
        return counted
    return f"{counted} in iteration {stage.iteration + 1}, particle {stage.particle + 1}"


def proposal(task: Task, trial: MotionRecord, summary: str) -> RenderableType:
    """The proposed action, its expected outcome, and the `summary` of its plan."""
    between = views.predicted_between(trial.predicted_low, trial.predicted_high)
    lines = (
        *_where(task, trial),
        f"Action   {views.values(task.action, trial.action_array)}",
        *(() if trial.is_blind else (f"Predicted reward {trial.predicted_reward:.2f} (95 % {between})",)),
        summary,
    )
    return views.indent(Group(*map(Text, lines)))


def _where(task: Task, trial: MotionRecord) -> tuple[str, ...]:
    if not trial.context:
        return ()
    if trial.goal_m is None:
        return (f"Found    {views.values(task.context, trial.context_array)}",)
    x_m, y_m = trial.goal_m
    return (f"Goal     x {x_m:.3f} m, y {views.signed(y_m, 3)} m",)


def trials_needed(forecast: TrialsForecast) -> str:
    """How many trials a session needs, in a sentence."""
    share, where = forecast.first_success.four_of_five, f"adaptsim checkpoints trials --task {forecast.task}"
    if share.most is None:
        return ""
    return (
        f"Of {forecast.sessions} imagined sessions {100 * share.share:.0f} % had a success by trial {share.most} "
        f"({where})."
    )


def tracked(record: TrialRecord) -> RenderableType:
    """The result of a trial beside its prediction."""
    style = "green" if record.is_rewarded else "yellow"
    result = Text.assemble("Tracked: ", (f"{record.outcome_words}, reward {record.reward:.2f}", style))
    if not record.is_blind:
        result.append(f" (predicted {record.predicted_reward:.2f})", "dim")
    if (off_mm := record.off_goal_mm) is not None:
        result.append(f", {off_mm:.0f} mm from the goal")
    return views.indent(Group(result, *[Text(f"note: {flag}", style="yellow") for flag in record.track.flags]))


def adapted(
    task: Task,
    before: Sequence[Particle],
    after: Sequence[Particle],
    result: ResultRecord,
    width: int,
    recordings: str = "",
    look: str = "",
) -> RenderableType:
    """The parameters of each particle before and after; in a narrow terminal, one table per particle.

    `recordings` is the folder of recorded trials; "" for new trials.
    """
    pairs = [(now.samples, then.samples) for now, then in zip(before, after, strict=True)]
    if width < max(len(d.title) for d in task.parameters.dimensions) + 2 + 24 * len(pairs):
        tables: list[RenderableType] = [_changes(task.parameters, [pair], first=i) for i, pair in enumerate(pairs)]
    else:
        tables = [_changes(task.parameters, pairs, first=0)]
    amended = [Text(f"New in this result: {one}.", style="magenta") for one in result.amended]
    now = views.values(task.parameters, np.array([result.best.params[name] for name in task.parameters.names]))
    best = Text(best_in_words(result.best, now))
    verdict = Text(in_words(result.verdict, task.object_name, recordings, look), style=_style(result))
    took = views.spent({stage: spent for stage, spent in result.timing_s.items() if stage != "total"})
    spent = f"The iteration took {took}; the next proposal was ready {result.proposal_s:.1f} s after the last trial"
    return Group(
        Text(""), Text("What changed", style="bold"), *amended, *(views.indent(table) for table in tables),
        best, *_correction(task, result), verdict, *_control(result), *_suspicion(result), Text(spent, style="dim"),
    )  # fmt: skip


def _control(result: ResultRecord) -> list[Text]:
    """The result of the control trials."""
    return [] if result.control is None else [Text(compared_in_words(result.control), style="bold")]


def _suspicion(result: ResultRecord) -> list[Text]:
    """The fault of the rig at which the trials hint."""
    if (suspicion := result.suspicion) is None:
        return []
    return [Text(f"{suspicion.question} {suspicion.why} {suspicion.look}.", style="bold yellow")]


def _correction(task: Task, result: ResultRecord) -> list[Text]:
    """How the best actions differ from the simulator's actions for the same parameters."""
    if result.outlook is None:
        return []
    terms = [
        f"{d.plain_name} {'+' if off > 0 else '−'}{views.quantity(abs(off), d.unit)}"
        for d, off in result.outlook.noticeable(task.action.dimensions)
    ]
    if not terms:
        return [Text("The actions are those that this simulator proposes.", style="dim")]
    return [Text(f"What the trials add to this simulator's action: {', '.join(terms)}")]


def _style(result: ResultRecord) -> str:
    return "bold" if result.outlook is not None and result.outlook.done else ""


def _changes(space: Space, pairs: Sequence[tuple[Array, Array]], first: int) -> Table:
    """Samples (m, p) of each particle before and after."""
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False)
    table.add_column("parameter")
    for index in range(len(pairs)):
        table.add_column(f"particle {first + index + 1}", justify="right")
        table.add_column("", justify="left")
    for row, dimension in enumerate(space.dimensions):
        factor, unit = views.scale_within(dimension.low, dimension.high, dimension.unit)
        cells: list[RenderableType] = [Text(replace(dimension, unit=unit).title)]
        for before, after in pairs:
            cells += _change(dimension, before[:, row], after[:, row], factor)
        table.add_row(*cells)
    return table


def _change(dimension: Dimension, before: Array, after: Array, factor: float) -> tuple[Text, Text]:
    """The mean of samples (m,) before and after, times `factor`; for a category, the share of each word."""
    if dimension.kinds:
        words, new = (views.sampled_in_words(dimension, one) for one in (before, after))
        if words == new:
            return Text(words, style="dim"), Text("=", style="dim")
        return Text(words), Text(f"→ {new}", style="blue")
    now, then = float(before.mean()), float(after.mean())

    def number(value: float) -> str:
        return views.with_signs(views.number(value))

    if np.isclose(now, then, rtol=1e-6, atol=1e-9 * (dimension.high - dimension.low)):
        return Text(number(factor * now), style="dim"), Text("=", style="dim")
    style = "green" if then > now else "blue"
    return Text(number(factor * now)), Text(f"{'↑' if then > now else '↓'} {number(factor * then)}", style=style)


def verified(checked: Sequence[Verified]) -> RenderableType:
    """The table of `sessions verify`, and below it every damaged file."""
    body = [(one.session, str(one.files), str(len(one.damage)) if one.damage else "none") for one in checked]
    table = views.rows(("session", "files", "damaged"), body, right=(1, 2))
    newer = (newer_note(one.session, one.newer_keys) for one in checked if one.newer_keys)
    return Group(table, *(Text(message) for one in checked for message in one.damage), *newer)


def newer_note(name: str, keys: Sequence[str]) -> Text:
    """The note on a session that a newer version wrote to."""
    return Text(
        f"{name} was written by a newer version of adaptsim, which added {', '.join(keys)}. This version keeps these "
        "values and does not use them; update adaptsim to see them"
    )


def session(shown: SessionShown) -> RenderableType:
    """The tables of `sessions show`."""
    facts, trials, results = shown.facts, shown.trials, shown.results
    where = views.where(facts["hw"], facts["world"])
    mark = views.RECORDED if facts["recorded"] else facts["hw"]
    head = Text.assemble(views.mark(mark), (f" {facts['name']}", "bold"), f"   {facts['task']}, {where}, ")
    head.append(f"method {facts['method']}, seed {facts['seed']}")
    body = [
        (
            str(trial.trial),
            str(trial.iteration),
            str(trial.particle),
            (trial.ended or views.words(trial.outcome.value)) + (" (operator)" if trial.overruled_from else ""),
            f"{trial.reward:.2f}",
            f"{trial.predicted_reward:.2f}",
        )
        for trial in trials
    ]
    table = views.rows(
        ("trial", "iteration", "particle", "outcome", "reward", "predicted"), body, right=(0, 1, 2, 4, 5)
    )
    rejected = [
        Text(f"Rejected: trial {r.trial}, attempt {r.attempt}: {r.reason}", style="yellow") for r in shown.rejected
    ]
    waiting = [
        Text(f"Recorded: trial {w.trial}, attempt {w.attempt}. It counts once it is reviewed.", style="yellow")
        for w in shown.waiting
    ]
    first = check_first(facts["task"], facts["hw"], facts["calibration"])
    last = [Text(in_words(results[-1].verdict, facts["object_name"], first=first))] if results else []
    newer = [newer_note(facts["name"], shown.newer_keys)] if shown.newer_keys else []
    return Group(head, Text(shown.folder, style="dim"), Text(""), table, *rejected, *waiting, *last, *newer)


def amended(changed: Amended, consequence: str) -> Reply:
    """The amendment or restoration of a trial, with its consequence in a sentence."""
    step = (f"adaptsim run-iteration --session {changed.session}", "adapts from it, and shows the change")
    return Reply(changed, [f"{changed.changed[:1].upper()}{changed.changed[1:]}.", consequence], [step])


NO_BREAK = "\N{NO-BREAK SPACE}"


def sessions(rows: Sequence[SessionRow | Damaged]) -> RenderableType:
    """Sessions with task, progress and result; damaged sessions come last."""
    whole = [part for s in rows if isinstance(s, SessionRow) for part in _session(s)]
    damaged = [Text.assemble((s.session, "bold"), f" {s.error}") for s in rows if isinstance(s, Damaged)]
    return Group(*whole, *damaged)


def size(count: int) -> str:
    """A size in bytes, in B, kB, MB or GB."""
    return f"{count / 1e9:.1f} GB" if count >= 1e9 else f"{count / 1e6:.0f} MB" if count >= 1e6 else "under 1 MB"


def _session(s: SessionRow) -> list[RenderableType]:
    facts = (
        s.task,
        views.where(s.hw, s.world),
        s.method,
        f"{_count(s.iterations, 'iteration')}, {_count(s.trials, 'trial')}",
        "no reward yet" if s.mean_reward is None else f"mean reward {s.mean_reward:.2f}",
        size(s.size_bytes),
        s.created[:16].replace("T", " "),
    )
    lines: list[RenderableType] = [_name(s.session, s.begun_as), _joined(facts)]
    if s.verdict:
        lines.append(views.indent(Text(HEADLINES[s.verdict.kind])))
    if s.note:
        lines.append(views.indent(Text(s.note, style="italic")))
    return lines


def _name(name: str, begun_as: str) -> Text:
    text = Text(name, style="bold", no_wrap=True, overflow="ignore")
    if begun_as:
        text.append(f"  begun as {begun_as}", style="dim")
    return text


def _joined(facts: Sequence[str]) -> RenderableType:
    return views.indent(Text(" · ".join(fact.replace(" ", NO_BREAK) for fact in facts), style="dim"))


def _count(n: int, what: str) -> str:
    return f"{n} {what}{'s' * (n != 1)}"
