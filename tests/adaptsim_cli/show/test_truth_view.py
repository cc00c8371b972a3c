"""Truth, range and belief: the table, the chart and the sentence at the end of a simulated session."""

from __future__ import annotations

import pytest

from adaptsim_cli.screen.outputs.learning import Revealed, RevealedParameter
from adaptsim_cli.show import truth_view

SHAPE = RevealedParameter(
    name="g", plain_name="shape", unit="", meaning="0 ellipsoid, 1 cylinder, 2 box", scale="integer",
    truth=1.0, low=0.0, high=1.0, believed=(1.0, 1.0, 2.0),
)  # fmt: skip
STIFF = RevealedParameter(
    name="e", plain_name="stiffness", unit="Pa", meaning="", scale="log",
    truth=1e6, low=1e4, high=5e5, believed=(2e4, 1e5, 8e5),
)  # fmt: skip
PATCH = RevealedParameter(
    name="y", plain_name="patch", unit="m", meaning="", scale="linear",
    truth=-0.0009, low=-0.1, high=0.1, believed=None,
)  # fmt: skip


def test_values_are_said_in_plain_units():
    assert truth_view.row(SHAPE) == ("shape", "cylinder", "ellipsoid to cylinder", "cylinder to box")
    assert truth_view.row(STIFF) == ("stiffness", "1 MPa *", "10 to 500 kPa", "20 to 800 kPa")
    assert truth_view.row(PATCH) == ("patch", "−0.9 mm", "−0.100 to 0.100 m", "no interval")


def test_the_chart_has_one_scale_for_range_belief_and_truth():
    drawn = truth_view.chart(STIFF)
    assert len(drawn) == truth_view.CHART
    assert drawn.index("│") == 0
    assert drawn.rindex("●") == truth_view.CHART - 1, "the truth lies beyond range and belief"
    assert 0 < drawn.index("━") < drawn.rindex("│")


@pytest.mark.parametrize(
    ("iterations", "last", "told"),
    [
        (1, 0.4, "this session's 10 trials earned 0.40, before it adapted for the first time."),
        (5, 0.9, "adapting earned 0.90 in iteration 5, 0.40 in the first: 10 trials were worth +0.50 of 1."),
        (5, 0.42, "in the first: no clear difference after 10 trials."),
        (5, 0.1, "it does not pay here so far, after 10 trials."),
    ],
)
def test_one_sentence_says_what_adapting_was_worth(iterations: int, last: float, told: str):
    shown = Revealed(
        session="s", method="adaptsim", world="w", parameters=[SHAPE], iterations=iterations, trials=10,
        first_reward=0.4, last_reward=last, udr_reward=0.4, udr_trials=32,
    )  # fmt: skip
    said = truth_view.in_words(shown)
    assert said.startswith("One policy for the whole range (UDR) earns 0.40 in w (32 simulated trials); ")
    assert said.endswith(told)
