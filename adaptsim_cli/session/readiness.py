"""The first screen of a command on a session: its progress, its notes, and the checks before a motion."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path

from rich.text import Text

from adaptsim_cli.config import Config
from adaptsim_cli.errors import PreflightFailed
from adaptsim_cli.screen.views import failures
from adaptsim_cli.session import terminal_views
from adaptsim_cli.session.control import cost_in_words, power_in_words
from adaptsim_cli.session.flow import RunningSession
from adaptsim_cli.session.preflight import preflight
from adaptsim_cli.session.records import SessionFacts
from sim.adaptation.methods import ignores_seed
from sim.adaptation.stages import next_stage
from sim.adaptation.trials_forecast import load as load_forecast
from sim.tasks import files_of


def _trials_needed(facts: SessionFacts) -> str:
    """How many trials a session like this needs, by the forecast beside its checkpoint; "" without one."""
    task, _, name = facts.checkpoint.partition("/")
    if facts.method != Config().method or facts.recorded or not name:
        return ""
    folder = Path(facts.checkpoint_folder or files_of(task, "checkpoints") / name)
    forecast = load_forecast(folder, facts.checkpoint_sha256)
    if forecast is None or forecast.particles != facts.particles:
        return ""
    return terminal_views.trials_needed(forecast)


def require_ready(session: RunningSession, config: Config, iterations: int) -> None:
    """Show the progress of the session, and check its target. Raises PreflightFailed."""
    facts, screen = session.store.facts, session.screen
    existing = session.store.existing()
    stage = next_stage(existing, facts.layout)
    task, title, is_new = session.parts.task, session.parts.target.title, not existing.started
    screen.show(terminal_views.session_header(task, facts, stage.iteration, title, is_new=is_new))
    if is_new and facts.seed and not facts.recorded and ignores_seed(facts.method, task):
        screen.note(
            f"Deterministic: nothing is drawn in {task.name}, nor by {facts.method}. Every seed gives this session, so "
            "one is enough."
        )
    if existing.completed:
        count = len(existing.completed)
        screen.note(
            f"Continuing after {count} trial{'s' if count > 1 else ''}. Another --session starts from the beginning."
        )
    if is_new and (trials_needed := _trials_needed(facts)):
        screen.show(Text(trials_needed, style="dim"))
    if facts.control:
        screen.note(cost_in_words(session.store, stage.iteration, iterations))
        if is_new:
            screen.note(power_in_words(facts))
    target = session.parts.target
    with (
        nullcontext() if target.needs_consent else screen.busy("Checking arm and camera", "checking")
    ):  # a real one may ask
        checks = preflight(target, facts, session.store.folder, config.min_free_mb)
    screen.checks(checks)
    if problem := failures(checks):
        raise PreflightFailed(f"not ready, nothing has moved: {problem}")
