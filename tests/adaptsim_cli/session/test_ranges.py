"""A posterior leaves as ranges: the joint samples carry its quantiles and its correlation, and Drake takes them."""

from __future__ import annotations

import json
import subprocess
import sys
import tomllib

import numpy as np
import pytest

from adaptsim_cli.session import hindsight, ranges
from adaptsim_cli.session.ranges import LEVELS, SNIPPETS, correlation
from sim.adaptation.posterior import Posterior
from sim.tasks import get_task

SPACE = get_task("scooping").margin


def correlated() -> Posterior:
    """Friction and height rise together; the shape is certain."""
    rng = np.random.default_rng(0)
    unit = rng.uniform(0.2, 0.8, (2000, len(SPACE)))
    unit[:, 3] = 0.8 * unit[:, 0] + 0.2 * unit[:, 3]
    samples = SPACE.denormalise(unit)
    samples[:, 2] = 1.0
    weights = rng.dirichlet(np.ones(2000))
    return Posterior(SPACE, samples, weights)


def test_the_correlation_is_that_of_the_weighted_samples_on_their_own_scales():
    posterior = correlated()
    found = correlation(posterior)
    drawn = SPACE.normalise(posterior.draw(20_000, np.random.default_rng(1)))
    assert found[0, 3] == pytest.approx(np.corrcoef(drawn[:, 0], drawn[:, 3])[0, 1], abs=0.02)
    assert found[0, 3] > 0.9
    assert np.array_equal(found[2], [0.0, 0.0, 1.0, 0.0]), "a certain parameter correlates with none"
    assert np.allclose(found, found.T)


def test_the_snippet_for_drake_runs(tmp_path):
    samples = correlated().draw(10, np.random.default_rng(0))
    (tmp_path / "ranges.json").write_text(json.dumps({"names": list(SPACE.names), "samples": samples.tolist()}))
    (tmp_path / "drake_ranges.py").write_text(SNIPPETS["drake_ranges.py"])
    ran = subprocess.run([sys.executable, tmp_path / "drake_ranges.py"], capture_output=True, text=True, check=True)
    assert "coulomb_friction" in ran.stdout


@pytest.mark.parametrize("name", SNIPPETS)
def test_each_snippet_is_python_and_says_whether_it_ever_ran(name):
    compile(SNIPPETS[name], name, "exec")
    assert ("nobody has run" in SNIPPETS[name]) == (name != "drake_ranges.py")


def test_an_export_holds_the_same_numbers_as_json_and_toml(tmp_path, monkeypatch):
    class Judge:
        def posterior(self, store: object) -> Posterior:
            return correlated()

    class Store:
        facts = type("F", (), {"name": "s", "task": "scooping"})

    monkeypatch.setattr(hindsight.Hindsight, "of", classmethod(lambda cls, store: Judge()))
    monkeypatch.setattr(ranges, "_trials", lambda store: ())
    files = ranges.ranges_files(Store())  # type: ignore[arg-type]  # its facts alone
    content = json.loads(files["ranges.json"])
    assert tomllib.loads(files["ranges.toml"].decode()) == content
    samples = np.array(content["samples"])
    low, high = (np.array(content["quantiles"]["mu"])[LEVELS.index(level)] for level in (0.05, 0.95))
    assert 0.85 <= np.mean((samples[:, 0] >= low) & (samples[:, 0] <= high)) <= 0.95
    assert content["units"] == ["", "Pa", "", "cm"]
    assert set(files) == {"ranges.json", "ranges.toml", *SNIPPETS}
