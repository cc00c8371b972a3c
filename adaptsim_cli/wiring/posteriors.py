"""The posteriors of stored sessions, by their checkpoints."""

from __future__ import annotations

from collections.abc import Sequence

from adaptsim_cli.report.posteriors import LEVELS, Believed
from adaptsim_cli.session.store import SessionStore
from adaptsim_cli.wiring.hindsight import Hindsight
from sim.errors import SimError


def believed(stores: Sequence[SessionStore]) -> tuple[Believed, ...]:
    """What each session believes of each parameter; sessions without a posterior are left out. Raises SessionError."""
    found = list[Believed]()
    for store in stores:
        try:
            levels = Hindsight.of(store).posterior(store).quantiles(LEVELS)
        except SimError:
            continue
        for d, (low, median, high) in zip(store.facts.parameters, levels.T, strict=True):
            found.append(Believed(store.facts.name, d.name, d.unit, float(low), float(median), float(high)))
    return tuple(found)
