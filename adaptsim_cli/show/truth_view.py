"""Truth, range and belief of a simulated session as a table and a small chart, for the terminal and the page."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
from rich.console import Group, RenderableType
from rich.text import Text

from adaptsim_cli.screen import views
from adaptsim_cli.screen.outputs.learning import Revealed, RevealedParameter
from sim.adaptation.method import WORTHWHILE

NO_BREAK = "\N{NO-BREAK SPACE}"

CHART = 16
"""Characters of the chart of a parameter."""


def in_plain_units(one: RevealedParameter, value: float) -> str:
    """A value as people say it: `cylinder`, `20 kPa`, `−0.9 mm`."""
    if one.scale == "integer":
        named: dict[str, str] = dict(re.findall(r"(\d+) (\w+)", one.meaning))
        return named.get(str(round(value)), str(round(value)))
    return views.quantity(value, one.unit)


def row(one: RevealedParameter) -> tuple[str, str, str, str]:
    """Plain name, truth, range of training and belief. A unit that all share stands behind the name."""
    values = [one.truth, one.low, one.high, *((one.believed[0], one.believed[2]) if one.believed else ())]
    texts = [in_plain_units(one, value) for value in values]
    units, name = {text.partition(" ")[2] for text in texts}, one.plain_name
    if len(units) == 1 and (unit := units.pop()):
        name, texts = f"{name}, {unit.replace(' ', NO_BREAK)}", [text.partition(" ")[0] for text in texts]
    truth, low, high, *ends = texts
    beyond = "" if one.low <= one.truth <= one.high else " *"
    return name, truth + beyond, _span(low, high), _span(*ends) if ends else "no interval"


def table(shown: Revealed) -> RenderableType:
    """The table with its chart, and one sentence on the gain of adapting."""
    body = [(*row(one), chart(one)) for one in shown.parameters]
    drawn = views.rows(("parameter", "truth", "range", "belief", ""), body)
    drawn.columns[-1].no_wrap = True
    beyond = "; * beyond that range" if any("*" in cells[1] for cells in body) else ""
    return Group(
        Text(""),
        Text(f"Truth, range and belief: what the session could not see in {shown.world}", style="bold"),
        views.indent(drawn),
        views.indent(Text(f"│ │ range of training, ━ belief (90 %), ● truth{beyond}", style="dim")),
        Text(in_words(shown)),
    )


def in_words(shown: Revealed) -> str:
    """The worth of adapting, in one sentence."""
    of_udr = (
        f"One policy for the whole range (UDR) earns {shown.udr_reward:.2f} in {shown.world} "
        f"({shown.udr_trials} simulated trials)"
    )
    first, last = shown.first_reward, shown.last_reward
    if shown.method == "udr":
        return f"{of_udr}; this session does not adapt: the last of its {shown.trials} trials earned {last:.2f}."
    if shown.iterations == 1:
        return (
            f"{of_udr}; this session's {shown.trials} trials earned {last:.2f}, before it adapted for the first time."
        )
    adapted = f"adapting earned {last:.2f} in iteration {shown.iterations}, {first:.2f} in the first"
    if last < shown.udr_reward - WORTHWHILE:
        return f"{of_udr}; {adapted}: it does not pay here so far, after {shown.trials} trials."
    if last < shown.udr_reward + WORTHWHILE:
        return f"{of_udr}; {adapted}: no clear difference after {shown.trials} trials."
    return f"{of_udr}; {adapted}: {shown.trials} trials were worth {views.signed(last - shown.udr_reward)} of 1."


def chart(one: RevealedParameter) -> str:
    """The range of training between bars, the belief as a thick line, the truth as a dot, on one scale."""
    ends = [one.low, one.high, one.truth, *(one.believed or ())]
    at = positions(one, ends, CHART - 1)
    cells = [" "] * CHART
    for i in range(at[0], at[1] + 1):
        cells[i] = "·"
    if one.believed is not None:
        for i in range(at[3], at[5] + 1):
            cells[i] = "━"
    cells[at[0]] = cells[at[1]] = "│"
    cells[at[2]] = "●"
    return "".join(cells)


def positions(one: RevealedParameter, values: Sequence[float], last: int) -> list[int]:
    """The places of values on a scale from 0 to `last` that holds them all; logarithmic where the parameter is."""
    shown = np.log(values) if one.scale == "log" and min(values) > 0.0 else np.asarray(values, dtype=float)
    low, high = float(shown.min()), float(shown.max())
    return [round(last * (float(v) - low) / (high - low)) if high > low else last // 2 for v in shown]


def _span(low: str, high: str) -> str:
    """`10 to 500 kPa`: equal ends, and a unit that both share, are said once."""
    (a, _, unit), (_, _, other) = low.partition(" "), high.partition(" ")
    return low if low == high else f"{a if unit == other else low} to {high}"
