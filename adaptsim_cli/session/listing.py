"""The lists of sessions and of rollouts on the screen; names are never wrapped."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Group, RenderableType
from rich.text import Text

from adaptsim_cli.outputs.sessions import Damaged, DamagedRollout, RolloutRow, SessionRow
from adaptsim_cli.screen import views
from adaptsim_cli.session.advice import HEADLINES

NO_BREAK = "\N{NO-BREAK SPACE}"


def sessions(found: Sequence[SessionRow | Damaged]) -> RenderableType:
    """Sessions with task, progress and result; damaged sessions come last."""
    whole = [part for s in found if isinstance(s, SessionRow) for part in _session(s)]
    damaged = [Text.assemble((s.session, "bold"), f" {s.error}") for s in found if isinstance(s, Damaged)]
    return Group(*whole, *damaged)


def rollouts(found: Sequence[RolloutRow | DamagedRollout]) -> RenderableType:
    """Rollouts with outcome and reward, one per line."""
    return Group(*(part for r in found for part in _rollout(r)))


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
    lines: list[RenderableType] = [_name(s.session, s.tags), _joined(facts)]
    if s.verdict:
        lines.append(views.indent(Text(HEADLINES[s.verdict.kind])))
    if s.note:
        lines.append(views.indent(Text(s.note, style="italic")))
    return lines


def _rollout(r: RolloutRow | DamagedRollout) -> list[RenderableType]:
    if isinstance(r, DamagedRollout):
        return [Text.assemble((r.rollout, "bold"), f" {r.error}")]
    facts = (
        r.task,
        views.where(r.hw, r.world),
        f"{views.words(r.outcome.value)}, reward {r.reward:.2f}",
        size(r.size_bytes),
    )
    return [_name(r.rollout, ()), _joined((*facts, r.when[:16].replace("T", " ")))]


def _name(name: str, tags: Sequence[str]) -> Text:
    text = Text(name, style="bold", no_wrap=True, overflow="ignore")
    for tag in tags:
        text.append(f"  #{tag}", style="magenta")
    return text


def _joined(facts: Sequence[str]) -> RenderableType:
    return views.indent(Text(" · ".join(fact.replace(" ", NO_BREAK) for fact in facts), style="dim"))


def _count(n: int, what: str) -> str:
    return f"{n} {what}{'s' * (n != 1)}"
