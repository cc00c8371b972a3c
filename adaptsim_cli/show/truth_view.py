"""Truth, range and belief of a simulated session as a table and a small chart, for the terminal and the page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from rich.console import Group, RenderableType
from rich.text import Text

from adaptsim_cli.screen import views
from adaptsim_cli.screen.outputs.learning import Revealed, RevealedParameter
from adaptsim_cli.session.advice import gain_in_words
from sim.adaptation.method import WORTHWHILE

NO_BREAK = "\N{NO-BREAK SPACE}"

CHART = 16
"""Characters of the chart of a parameter."""

FINEST = 200
"""Steps of a parameter's scale. An exact belief that ends within one step of the truth counts as containing it."""


LEAST_CHANCE = 0.05
"""A belief that gives a true word less than this misses it."""


def row(one: RevealedParameter) -> tuple[str, str, str, str]:
    """Plain name with the unit, truth, range of training and belief. All values have the unit in which people read the
    range. The belief about a category is the chance of each word.
    """
    if one.kinds:
        trained = one.kinds[round(one.low) : round(one.high) + 1]
        word = one.kinds[round(one.truth)]
        belief = "no interval" if one.chances is None else views.chances_in_words(one.kinds, one.chances)
        return one.plain_name, word + ("" if word in trained else " *"), ", ".join(trained), belief
    factor, unit = views.scale_within(one.low, one.high, one.unit)
    name = f"{one.plain_name}, {unit.replace(' ', NO_BREAK)}" if unit else one.plain_name
    values = [one.truth, one.low, one.high, *((one.believed[0], one.believed[2]) if one.believed else ())]
    if one.scale == "integer":
        values = [float(round(value)) for value in values]
    truth, low, high, *ends = (views.with_signs(views.number(factor * value)) for value in values)
    beyond = "" if one.low <= one.truth <= one.high else " *"
    return name, truth + beyond, _span(low, high), _span(*ends) if ends else "no interval"


def table(shown: Revealed) -> RenderableType:
    """The table with its chart, and one sentence on the gain of adapting."""
    body = list[tuple[str, ...]]()
    for one in shown.parameters:
        *left, belief = row(one)
        body.append((*left, belief.replace("%, ", "%\n"), chart(one)))  # each word of a category has a line
    drawn = views.rows(("parameter", "truth", "range", "belief", ""), body, whole=(3, 4))
    beyond = "; * beyond that range" if any("*" in cells[1] for cells in body) else ""
    return Group(
        Text(""),
        Text(f"Truth, range and belief: what the session could not see in {shown.world}", style="bold"),
        views.indent(drawn),
        views.indent(Text(f"│ │ range of training, ━ belief (90 %), ● truth{beyond}", style="dim")),
        *([Text(why)] if (why := misses_in_words(shown)) else []),
        Text(in_words(shown)),
    )


@dataclass(frozen=True)
class UdrReward:
    """The mean reward of UDR where a session runs."""

    reward: float
    source: str  # simulated truth, or the session that measured it
    place: str  # "in ood-2" or "here"

    @classmethod
    def true(cls, shown: Revealed) -> UdrReward:
        """The reward of UDR in a simulated world."""
        count = f"{shown.udr_trials} trial{'s' * (shown.udr_trials != 1)}"
        return cls(shown.udr_reward, f"simulated truth, {count}", f"in {shown.world}")

    @property
    def in_words(self) -> str:
        """As part of a sentence."""
        return f"UDR {self.place} {self.reward:.2f} ({self.source})"


def in_words(shown: Revealed) -> str:
    """The gain of adapting, in two sentences."""
    measured = f"{gain_in_words(shown.rewards)}; {UdrReward.true(shown).in_words}."
    if shown.method == "udr":
        return f"{measured} This session does not adapt."
    if len(shown.rewards) == 1:
        return f"{measured} The first iteration ran before the session adapted for the first time."
    more = shown.rewards[-1] - shown.udr_reward
    if abs(more) < WORTHWHILE:
        compared = "The last iteration earned about as much as UDR, one policy for the whole range"
    else:
        than = f"{abs(more):.2f} {'more' if more > 0.0 else 'less'} than UDR, one policy for the whole range"
        compared = f"The last iteration earned {than}"
    return f"{measured} {compared}, after {shown.trials} trials{_chosen(shown.chosen_after)}."


def _chosen(after: int | None) -> str:
    if after is None:
        return ""
    return f"; its best policy was chosen after {after} of them" if after else "; its best policy is one of the first"


def misses_in_words(shown: Revealed) -> str:
    """Why the belief does not contain the truth of some parameters; "" if it contains all."""
    missed = [one for one in shown.parameters if one.believed and not _holds(one)]
    if not missed:
        return ""
    beyond = [one.plain_name for one in missed if not one.low <= one.truth <= one.high]
    others = [one.plain_name for one in missed if one.plain_name not in beyond]
    sentences = [f"The belief misses {listed([one.plain_name for one in missed])}."]
    if beyond:
        lie = "lies" if len(beyond) == 1 else "lie"
        sentences.append(f"The true {listed(beyond)} {lie} beyond the range of training.")
    if others:
        sentences.append(
            "The belief contains the values with which the training simulator reproduces the observed motions. Values "
            "that change a motion alike replace each other."
        )
    if shown.unmodelled:
        effects = listed([views.words(name) for name in shown.unmodelled])
        sentences.append(f"This world also differs in {effects}, which no parameter expresses.")
    return " ".join(sentences)


def _holds(one: RevealedParameter) -> bool:
    assert one.believed is not None, "only parameters with an interval are asked about"
    if one.chances is not None:
        return one.chances[round(one.truth)] >= LEAST_CHANCE
    if one.scale == "integer":
        return one.believed[0] <= one.truth <= one.believed[2]
    *_, truth, low, _, high = positions(one, [one.low, one.high, one.truth, *one.believed], FINEST)
    return low - 1 <= truth <= high + 1


def listed(names: Sequence[str]) -> str:
    """Names as people list them: `a, b and c`."""
    *before, last = names
    return f"{', '.join(before)} and {last}" if before else last


def chart(one: RevealedParameter) -> str:
    """The training range between bars, the belief as a thick line and the truth as a dot, on one scale. A category has
    no chart.
    """
    if one.kinds:
        return ""
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
    """The places of values on a scale from 0 to `last` that contains them all. It is logarithmic if the parameter's
    scale is.
    """
    shown = np.log(values) if one.scale == "log" and min(values) > 0.0 else np.asarray(values, dtype=float)
    low, high = float(shown.min()), float(shown.max())
    return [round(last * (float(v) - low) / (high - low)) if high > low else last // 2 for v in shown]


def _span(low: str, high: str) -> str:
    """`10 to 500`; equal ends are written once."""
    return low if low == high else f"{low} to {high}"
