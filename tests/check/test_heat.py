"""Which parameters heat can imitate: known cases, and the formulas against dense ones."""

from dataclasses import replace

import numpy as np
import pytest

from flightcal.check.findings import heat_findings
from flightcal.check.heat import WIDER, _compared, beside_heat
from flightcal.problem import Entry, build_problem
from flightcal.scenario import Normal

from .. import small

NOISE = 0.05  # K


def at_median(problem):
    """The prior's median, with a thermistor's noise."""
    theta = problem.priors.median()
    noise = [name.startswith("noise") and not name.endswith("time") for name in problem.names]
    return problem.to_z(np.where(noise, NOISE, theta))


def found_for(folder, content):
    problem = build_problem(*small.closed_loop(folder, content | {"heat": {}}))
    found = beside_heat(problem, at_median(problem))
    return found, {parameter.name: parameter for parameter in found.parameters}


def sunlit():
    """The panel's face sees the Sun, the Earth and the eclipse, and there is no other load."""
    content = small.content()
    content["environment"] = {
        "orbit": {"altitude": "693 km", "inclination": "98.18 deg", "ltan": "22:30", "epoch": "2024-03-01T00:00:00"},
        "attitude": "nadir",
    }
    model = content["simulator"]
    del model["loads"]
    model["faces"] = {
        "side": {"node": "panel", "area": "0.1 m^2", "absorptivity": 0.6, "emissivity": 0.5, "normal": [1, 0, 0]}
    }
    del content["parameters"]["panel_size"]
    content["parameters"]["absorptivity"] = {
        "sets": "faces.side.absorptivity", "prior": {"uniform": [0.3, 0.9]}
    }  # fmt: skip
    return content


@pytest.fixture(scope="module")
def heated(tmp_path_factory):
    return found_for(tmp_path_factory.mktemp("heated"), sunlit())


def test_heat_that_follows_the_eclipse_imitates_an_absorptivity(heated):
    _, found = heated
    assert found["absorptivity"].cosine > 0.95
    assert found["absorptivity"].node == "panel"
    assert found["absorptivity"].kind == "surface"
    assert found["absorptivity"].matters


def test_what_is_well_told_beside_heat_is_no_matter(heated):
    _, found = heated
    absorptivity = replace(found["absorptivity"], without=0.005, beside=0.05)
    assert absorptivity.growth > WIDER
    assert not absorptivity.matters
    assert replace(absorptivity, beside=0.5).matters


def test_heat_in_one_node_does_not_imitate_a_conductance_between_two_that_a_heater_excites(tmp_path):
    _, found = found_for(tmp_path, small.content())
    assert found["link"].cosine < 0.9
    assert found["power"].cosine > 0.9
    assert all(parameter.without < parameter.beside < 1.0 for parameter in found.values())


def test_a_problem_without_heat_is_not_looked_at(tmp_path):
    problem = build_problem(*small.closed_loop(tmp_path, small.content()))
    assert beside_heat(problem, problem.to_z(problem.priors.median())) is None


def entry(name, kind="parameter", sets=()):
    return Entry(name, "W", Normal(mean=0.0, standard_deviation=1.0), kind, sets)


def test_widths_and_cosines_are_those_of_dense_matrices():
    rng = np.random.default_rng(0)
    effect, heat = rng.standard_normal((60, 4)), 0.3 * rng.standard_normal((60, 10))
    entries = [entry("a"), entry("b"), entry("c"), entry("initial.d", "initial")]
    found = _compared(entries, effect, heat, {"left": heat[:, :6], "right": heat[:, 6:]})
    covariance = np.eye(60) + heat @ heat.T
    for width, known in (("without", np.eye(60)), ("beside", covariance)):
        exact = np.sqrt(np.diag(np.linalg.inv(np.eye(4) + effect.T @ np.linalg.solve(known, effect))))
        values = {item.name: getattr(item, width) for item in found.parameters}
        np.testing.assert_allclose([values[name] for name in "abc"], exact[:3], rtol=1e-10)
    start = effect[:, 3] / np.linalg.norm(effect[:, 3])
    projector = np.eye(60) - np.outer(start, start)
    for item in found.parameters:
        column = projector @ effect[:, "abc".index(item.name)]
        shares = []
        for part in (heat[:, :6], heat[:, 6:]):
            projected = projector @ part
            shares.append(
                1.0 - column @ np.linalg.solve(np.eye(60) + projected @ projected.T, column) / (column @ column)
            )
        assert item.cosine == pytest.approx(np.sqrt(max(shares)))
        assert item.node == ("left", "right")[int(np.argmax(shares))]


def test_two_parameters_that_one_heat_imitates_are_named_together():
    rng = np.random.default_rng(1)
    shape, rest = rng.standard_normal((2, 200))
    effect = 10.0 * np.stack([shape, -shape + 0.2 * rest, rest], axis=1)
    found = _compared([entry("a"), entry("b"), entry("c")], effect, shape[:, None], {"body": shape[:, None]})
    ((first, second, node, cosine),) = found.pairs
    assert (first, second, node) == ("a", "b", "body")
    assert cosine == pytest.approx(1.0)


def test_a_finding_says_what_heat_takes_and_what_would_tell(heated):
    found, by_name = heated
    words = heat_findings(found)
    (surface,) = [finding for finding in words if "absorptivity" in finding.title]
    assert surface.state == "warn"
    assert "Other eclipses or attitudes than those in the training windows would tell" in surface.text
    parameter = by_name["absorptivity"]
    (line,) = surface.details
    assert line == (
        f"Heat in panel can imitate absorptivity (cosine {parameter.cosine:.2f}): its interval will be about "
        f"{parameter.growth:.0f} times as wide as without heat, {100 * parameter.beside:.0f}% as wide as the prior's."
    )
    plain = tuple(replace(item, cosine=0.1, beside=item.without) for item in found.parameters)
    (good,) = heat_findings(replace(found, parameters=plain, pairs=()))
    assert good.state == "good"
    assert heat_findings(None) == []
