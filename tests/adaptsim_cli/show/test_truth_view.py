"""Truth, range and belief: the table, the chart and the sentence at the end of a simulated session."""

from __future__ import annotations

import io

import pytest
from rich.console import Console

from adaptsim_cli.screen.outputs.learning import Revealed, RevealedParameter
from adaptsim_cli.show import figures, truth, truth_view
from sim.lab.world import load_world
from sim.tasks import get_task
from sim.tasks.own_object import task_of_object

SHAPE = RevealedParameter(
    name="g", plain_name="shape", unit="", meaning="0 ellipsoid, 1 cylinder, 2 box", scale="integer",
    truth=1.0, low=0.0, high=1.0, believed=(1.0, 1.0, 2.0), kinds=["ellipsoid", "cylinder", "box"],
    chances=[0.001, 0.719, 0.28],
)  # fmt: skip
STIFF = RevealedParameter(
    name="e", plain_name="stiffness", unit="Pa", meaning="", scale="log",
    truth=1e6, low=1e4, high=5e5, believed=(2e4, 1e5, 8e5),
)  # fmt: skip
PATCH = RevealedParameter(
    name="y", plain_name="patch", unit="m", meaning="", scale="linear",
    truth=-0.0009, low=-0.1, high=0.1, believed=None,
)  # fmt: skip


def test_all_values_of_a_row_have_the_unit_of_its_range():
    assert truth_view.row(SHAPE) == ("shape", "cylinder", "ellipsoid, cylinder", "cylinder 72 %, box 28 %")
    assert truth_view.row(STIFF) == ("stiffness, kPa", "1000 *", "10 to 500", "20 to 800")
    assert truth_view.row(PATCH) == ("patch, mm", "−0.9", "−100 to 100", "no interval")


@pytest.mark.parametrize("width", [60, 80, 120])
def test_a_number_in_the_table_never_loses_its_percent_sign(width: int):
    console = Console(width=width, file=io.StringIO())
    with console.capture() as capture:
        console.print(truth_view.table(shown(0.4, parameters=[SHAPE, STIFF])))
    assert "cylinder 72 %" in capture.get()
    assert "box 28 %" in capture.get()


def test_a_category_has_no_order_so_its_belief_is_the_chance_of_each_word():
    sure = SHAPE.model_copy(update={"chances": [0.0, 1.0, 0.0], "truth": 2.0})
    assert truth_view.row(sure) == ("shape", "box *", "ellipsoid, cylinder", "cylinder")
    assert truth_view.chart(SHAPE) == ""
    assert "misses shape" in truth_view.misses_in_words(shown(0.4, parameters=[sure]))
    drawn = figures.truth(SHAPE)
    assert "cylinder: 72 %" in drawn
    assert "truth: cylinder" in drawn
    assert "ellipsoid: " not in drawn, "less than half a per cent"


def test_the_chart_has_one_scale_for_range_belief_and_truth():
    drawn = truth_view.chart(STIFF)
    assert len(drawn) == truth_view.CHART
    assert drawn.index("│") == 0
    assert drawn.rindex("●") == truth_view.CHART - 1, "the truth lies beyond range and belief"
    assert 0 < drawn.index("━") < drawn.rindex("│")


def shown(*rewards: float, **changes: object) -> Revealed:
    values = {"session": "s", "method": "adaptsim", "world": "w", "parameters": [SHAPE], "unmodelled": [], "trials": 10}
    earned = {"rewards": list(rewards), "chosen_after": 2, "udr_reward": 0.12, "udr_trials": 32}
    return Revealed.model_validate(values | earned | changes)


UDR = "UDR in w 0.12 (simulated truth, 32 trials)."
BEST = "after 10 trials; its best policy was chosen after 2 of them."


@pytest.mark.parametrize(
    ("rewards", "told"),
    [
        ([0.46], f"Mean reward 0.46 in the first iteration; {UDR} The first iteration ran before the session adapted"),
        (
            [0.46, 0.91],
            f"Mean reward 0.46 in the first iteration, 0.91 in the second; {UDR} The last iteration earned 0.79 more "
            f"than UDR, one policy for the whole range, {BEST}",
        ),
        ([0.46, 0.14], f"The last iteration earned about as much as UDR, one policy for the whole range, {BEST}"),
        ([0.46, 0.05], f"The last iteration earned 0.07 less than UDR, one policy for the whole range, {BEST}"),
    ],
)
def test_the_gain_stands_beside_udr_in_the_same_world(rewards: list[float], told: str):
    assert told in truth_view.in_words(shown(*rewards))


def test_a_belief_that_holds_the_truth_needs_no_reason():
    assert truth_view.misses_in_words(shown(0.4)) == ""
    assert truth_view.misses_in_words(shown(0.4, parameters=[PATCH])) == "", "without an interval nothing is claimed"


@pytest.mark.parametrize(("ends", "holds"), [((0.3000008, 0.30001, 0.30003), True), ((0.32, 0.33, 0.34), False)])
def test_an_exact_belief_holds_a_truth_that_it_meets_up_to_rounding(ends, holds):
    exact = PATCH.model_copy(update={"low": 1.0, "high": 2.0, "truth": 0.3, "believed": ends})
    assert (truth_view.misses_in_words(shown(0.4, parameters=[exact])) == "") is holds


def test_a_belief_that_misses_the_truth_says_why():
    within = SHAPE.model_copy(update={"truth": 0.0})
    beyond = STIFF.model_copy(update={"believed": (2e4, 1e5, 4e5)})
    said = truth_view.misses_in_words(shown(0.4, parameters=[beyond, within], unmodelled=["density_scale", "edge"]))
    assert said.startswith("The belief misses stiffness and shape. The true stiffness lies beyond the range")
    assert "reproduces the observed motions" in said
    assert said.endswith("This world also differs in density scale and edge, which no parameter expresses.")


def test_an_object_whose_scene_has_the_edge_of_the_world_does_not_differ_in_it():
    world = load_world("oreo", get_task("scooping"))
    assert truth._unmodelled(get_task("scooping"), world) == ["density_scale", "edge"]
    assert truth._unmodelled(task_of_object("scooping", "blunt-edge"), world) == ["density_scale"]
