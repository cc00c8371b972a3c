"""Compares several sessions of one task on one page and in two tables: by session, by method, trial by trial."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import stats

from adaptsim_cli.errors import UsageError
from adaptsim_cli.screen.html import fill
from adaptsim_cli.screen.outputs.sessions import ComparedMethod, ParameterBelief
from adaptsim_cli.screen.svg import plain
from adaptsim_cli.screen.views import chances_in_words
from adaptsim_cli.session.advice import check_first, in_words, tried_in
from adaptsim_cli.session.exporting import Row, as_csv, rows
from adaptsim_cli.session.history import results_of, trials_of
from adaptsim_cli.session.judgement import MeanReward, iteration_means
from adaptsim_cli.session.records import ResultRecord, SessionFacts, TrialRecord
from adaptsim_cli.session.store import SessionStore
from adaptsim_cli.show import figures
from adaptsim_cli.show.figures import Level
from adaptsim_cli.show.page import both, parameters_in_words
from adaptsim_cli.storage import durable
from sim.adaptation.posterior import COLLAPSED

UDR = "udr"
PAGE, SESSIONS, TRIALS = "comparison.html", "sessions.csv", "trials.csv"


@dataclass(frozen=True)
class ComparedSession:
    """One session of a comparison."""

    facts: SessionFacts
    trials: tuple[TrialRecord, ...]  # counting trials, in order
    result: ResultRecord | None  # of the last complete iteration
    iterations: tuple[MeanReward, ...]  # of each complete one; see `iteration_means`
    table: tuple[Row, ...]

    @property
    def target_name(self) -> str:
        """The place of its trials, for a person."""
        facts = self.facts
        if facts.recorded:
            return f"recorded trials {facts.recorded.split('/')[-1]}"
        world = facts.world.split("/")[-1].removesuffix(".toml")
        return f"world {world}" if world else f"real robot {facts.hw}"

    @property
    def day(self) -> str:
        """When it was begun, as an ISO date."""
        return self.facts.created[:10]

    @property
    def title(self) -> str:
        """The name of the session among the compared ones."""
        return f"{self.facts.method}, {self.target_name}, seed {self.facts.seed}"

    @property
    def verdict(self) -> str:
        """The verdict after its last iteration, in words."""
        f = self.facts
        return (
            in_words(self.result.verdict, f.object_name, f.recorded, check_first(f.task, f.hw, f.calibration))
            if self.result
            else "No iteration is complete yet."
        )

    @property
    def best(self) -> str:
        """The best parameters so far, with names and units; "" before the first result."""
        return parameters_in_words(self.facts, self.result.best.params) if self.result else ""

    @property
    def course(self) -> tuple[tuple[str, tuple[float, ...], float], ...]:
        """Method, action and reward of every trial, which are the same for sessions that repeat each other."""
        method = self.facts.method
        return tuple((method, tuple(trial.action_array.tolist()), trial.reward) for trial in self.trials)

    @property
    def pair(self) -> tuple[str, str, int]:
        """The key for pairing sessions of different methods."""
        return self.facts.hw, self.facts.world_sha256, self.facts.seed

    def as_row(self) -> Row:
        """A row of `sessions.csv`."""
        facts, first, last, best = self.facts, self.iterations[0], self.iterations[-1], self.result
        return {
            **facts.named(),
            "day": self.day,
            "iterations": len(self.iterations),
            "trials": len(self.trials),
            "first_reward": first.mean,
            "first_low": first.low,
            "first_high": first.high,
            "last_reward": last.mean,
            "last_low": last.low,
            "last_high": last.high,
            "best_reward": best.best.mean_reward if best else "",
            "best_low": best.best.ci95[0] if best else "",
            "best_high": best.best.ci95[1] if best else "",
            "verdict": best.verdict.kind.value if best else "",
        }


def compared(stores: Sequence[SessionStore]) -> tuple[ComparedSession, ...]:
    """Read the sessions.

    Raises UsageError unless there are two or more sessions of one task, each with a trial; SessionError on damage.
    """
    if len(stores) < 2:
        raise UsageError("compare needs two sessions or more: adaptsim sessions list names them")
    tasks = {store.facts.task for store in stores}
    if len(tasks) > 1:
        raise UsageError(f"the sessions are of different tasks ({', '.join(sorted(tasks))}): compare those of one task")
    return tuple(compared_session(store) for store in stores)


def identical(sessions: Sequence[ComparedSession]) -> tuple[tuple[str, ...], ...]:
    """Names of the sessions whose trials all repeat each other, group by group."""
    groups: dict[object, list[str]] = {}
    for c in sessions:
        groups.setdefault((c.pair[:2], c.course), []).append(c.facts.name)
    return tuple(tuple(names) for names in groups.values() if len(names) > 1)


def repetitions(sessions: Sequence[ComparedSession]) -> tuple[str, ...]:
    """A sentence for each group of identical sessions."""
    return tuple(
        f"{', '.join(names[:-1])} and {names[-1]} are identical, trial by trial: they count as one session."
        for names in identical(sessions)
    )


def _different(sessions: Sequence[ComparedSession]) -> list[ComparedSession]:
    """The sessions without those that repeat an earlier one."""
    first: dict[object, ComparedSession] = {}
    for c in sessions:
        first.setdefault((c.pair[:2], c.course), c)
    return list(first.values())


def by_method(every: Sequence[ComparedSession]) -> tuple[ComparedMethod, ...]:
    """The sessions of each method, pooled, and paired with the first method by world and seed.

    Identical sessions count as one.
    """
    sessions = _different(every)
    methods = tuple(dict.fromkeys(c.facts.method for c in sessions))
    ends = {m: {c.pair: c.iterations[-1].mean for c in sessions if c.facts.method == m} for m in methods}
    result = []
    for method in methods:
        values = [c.iterations[-1].mean for c in sessions if c.facts.method == method]
        shared = [pair for pair in ends[method] if pair in ends[methods[0]]]
        apart = [ends[method][pair] - ends[methods[0]][pair] for pair in shared] if method != methods[0] else []
        last, above = interval_over(values), interval_over(apart, -1.0)
        result.append(
            ComparedMethod(
                method=method,
                sessions=len(values),
                identical=sum(c.facts.method == method for c in every) - len(values),
                last_reward=float(np.mean(values)),
                last_ci95=None if last is None else last[1:],
                pairs=0 if above is None else len(apart),
                difference=None if above is None else above[0],
                difference_ci95=None if above is None else above[1:],
            )
        )
    return tuple(result)


def conclusions(sessions: Sequence[ComparedSession]) -> tuple[str, ...]:
    """A sentence for each session that has a UDR session in the same world with the same seed."""
    udr = {c.pair: c for c in sessions if c.facts.method == UDR}
    sentences = []
    for c in sessions:
        if c.pair in udr and c.facts.method != UDR:
            count = len(c.iterations)
            last = f", after {count} iterations {c.iterations[-1].mean:.2f}" if count > 1 else ""
            name = c.target_name[:1].upper() + c.target_name[1:]
            sentences.append(
                f"{name}: UDR {udr[c.pair].iterations[-1].mean:.2f}, first policies of "
                f"{c.facts.method} {c.iterations[0].mean:.2f}{last} (mean rewards)."
            )
    return tuple(sentences)


def within(belief: ParameterBelief) -> str:
    """The interval of a belief with its unit, or the chances of a category; without an interval, the reason."""
    if belief.low is None or belief.high is None:
        return COLLAPSED
    if belief.chances is not None:
        return chances_in_words([*belief.chances], [*belief.chances.values()])
    return f"{plain(belief.low)} to {plain(belief.high)} {belief.unit}".rstrip()


def disagreements(beliefs: Sequence[ParameterBelief]) -> tuple[str, ...]:
    """One sentence for each parameter whose 90 % intervals in two sessions do not overlap, or one if all overlap."""
    collapsed = dict.fromkeys(one.session for one in beliefs if one.low is None)
    sentences = [f"The posterior of {name} is {COLLAPSED}." for name in collapsed]
    beliefs = [one for one in beliefs if one.session not in collapsed]
    for parameter in dict.fromkeys(one.parameter for one in beliefs):
        mine = [one for one in beliefs if one.parameter == parameter]
        apart = [(a, b) for a, b in itertools.combinations(mine, 2) if _gap(a, b) > 0.0]
        if apart:
            a, b = max(apart, key=lambda pair: _gap(*pair))
            count = f"; {len(apart)} pairs in all" if len(apart) > 1 else ""
            sentences.append(
                f"The posteriors disagree in {parameter}: {a.session} has {within(a)}, {b.session} {within(b)} "
                f"(90 %){count}."
            )
    if len({one.session for one in beliefs}) < 2:
        return tuple(sentences)
    return tuple(sentences) or ("The posteriors disagree in no parameter: all 90 % intervals overlap.",)


def _gap(a: ParameterBelief, b: ParameterBelief) -> float:
    """How far two intervals are apart, in the parameter's unit; negative if they overlap, or if one is missing. For a
    category, it is the share of belief that the two do not have in common, minus 90 %.
    """
    if a.chances is not None and b.chances is not None:
        return 0.1 - sum(min(chance, b.chances.get(kind, 0.0)) for kind, chance in a.chances.items())
    if a.low is None or a.high is None or b.low is None or b.high is None:
        return -1.0
    return max(a.low - b.high, b.low - a.high)


def write(sessions: Sequence[ComparedSession], folder: Path, beliefs: Sequence[ParameterBelief] = ()) -> Path:
    """Write page and tables into `folder` and return the page's path. Raises SessionError, DiskFull."""
    durable.make_folder(folder)
    durable.replace_file(folder / SESSIONS, as_csv([c.as_row() for c in sessions]).encode())
    durable.replace_file(folder / TRIALS, as_csv([row for c in sessions for row in c.table]).encode())
    durable.replace_file(folder / PAGE, render(sessions, beliefs).encode())
    return folder / PAGE


def render(sessions: Sequence[ComparedSession], beliefs: Sequence[ParameterBelief] = ()) -> str:
    """The page as HTML."""
    methods = by_method(sessions)
    colours = {row.method: f"c{index % 6}" for index, row in enumerate(methods)}
    bars = [level for c in sessions for level in _levels(c, colours[c.facts.method])]
    lines = [
        [Level(c.facts.name, "", "", m.mean, m.low, m.high, colours[c.facts.method]) for m in c.iterations]
        for c in sessions
    ]
    title = sessions[0].facts.title
    return fill(
        "show/comparison.html.j2",
        sessions=sessions,
        title=title[:1].upper() + title[1:],
        methods=methods,
        colours=colours,
        worlds=sorted({c.target_name for c in sessions}),
        days=sorted({c.day for c in sessions}),
        figure_levels=both(lambda width: figures.levels(bars, width)),
        figure_lines=both(lambda width: figures.lines(lines, width)),
        beliefs=[(one, within(one)) for one in sorted(beliefs, key=lambda one: one.parameter)],
        disagreements=disagreements(beliefs),
        repetitions=repetitions(sessions),
        sessions_csv=SESSIONS,
        trials_csv=TRIALS,
    )


def compared_session(store: SessionStore) -> ComparedSession:
    """Read one session. Raises UsageError without a completed trial, SessionError on damage."""
    trials = trials_of(store)
    if not trials:
        raise UsageError(f"session {store.facts.name!r} has no completed trial yet: leave it out")
    results = results_of(store)
    return ComparedSession(
        facts=store.facts,
        trials=trials,
        result=results[-1] if results else None,
        iterations=iteration_means(store.facts, trials),
        table=tuple(rows(store)),
    )


def _levels(c: ComparedSession, colour: str) -> tuple[Level, ...]:
    """Measured rewards of the first and last iteration, and the predicted reward of the best policy."""
    numbered = {"first": (1, c.iterations[0]), "last": (len(c.iterations), c.iterations[-1])}
    if len(c.iterations) == 1:
        del numbered["last"]
    rows = [
        Level(c.facts.name, short, f"iteration {n}, {m.trials} trials", m.mean, m.low, m.high, colour)
        for short, (n, m) in numbered.items()
    ]
    if c.result is not None and c.facts.method != "udr":
        best, kind = c.result.best, "predicted" if c.result.outlook else "estimated"
        detail = f"best policy, {kind} from {best.trials} trial{'s' * (best.trials != 1)}"
        detail += f"; {where}" if (where := tried_in(best)) else ""
        rows.append(Level(c.facts.name, kind, detail, best.mean_reward, *best.ci95, colour, is_open=True))
    return tuple(rows)


def interval_over(values: Sequence[float], least: float = 0.0) -> tuple[float, float, float] | None:
    """Mean with its 95 % interval (Student's t over sessions); None for fewer than two.

    Its ends stay in the range of a reward, 0 to 1; for a difference of rewards, `least` is -1.
    """
    if len(values) < 2:
        return None
    mean, error = float(np.mean(values)), float(np.std(values, ddof=1) / np.sqrt(len(values)))
    half = float(stats.t.ppf(0.975, len(values) - 1)) * error
    return mean, max(mean - half, least), min(mean + half, 1.0)
