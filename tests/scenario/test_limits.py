"""Numbers that nobody means are refused with their line; what could be meant is a warning."""

from pathlib import Path

import pytest
from typer.testing import CliRunner

from flightcal.cli import app
from flightcal.errors import FlightcalError, memory_size, require_memory
from flightcal.scenario import lint, load_scenario
from flightcal.scenario.checks import calibration

EXAMPLE = Path(__file__).parent / "example.yaml"


@pytest.fixture
def edited(tmp_path):
    """The example with one replacement."""

    def write(old, new):
        text = EXAMPLE.read_text()
        assert text.count(old) == 1, old
        path = tmp_path / "scenario.yaml"
        path.write_text(text.replace(old, new))
        (tmp_path / "example.csv").write_text(EXAMPLE.with_suffix(".csv").read_text())
        return path

    return write


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("power: 22 W", "power: 1e9 W", "found '1e9 W', expected at most 1e+06 W"),
        ("step: 30 s", "step: 1e-9 s", "found '1e-9 s', expected at least 0.01 s"),
        ("step: 30 s", "step: 365 day", "found '365 day', expected at most 3600 s"),
        ("off_above: 13 degC", "off_above: 5000 degC", "found '5000 degC', expected at most 2000 K"),
        ("capacity: 9000 J/K", "capacity: 1e300 J/K", "found '1e300 J/K', expected at most 1e+09 J/K"),
        ("imaging: {battery: 6 W,", "imaging: {battery: -1e9 W,", "found '-1e9 W', expected at most 1e+06 W"),
        ("{median: 0.8 W/K, factor: 2}", "{median: 0.8 W/K, factor: 1e9}", "found 1000000000.0, expected at most 1000"),
        ("{half_normal: 20 W}", "{half_normal: 1e8 W}", "found a prior that reaches 1e+08 W for modes.imaging.payload"),
        ("chains: 4", "chains: 5000", "found 5000, expected at most 100"),
        ("draws: 1000}", "draws: 1000000000}", "found 1000000000, expected at most 1e+06"),
        ("chains: 4", "max_r_hat: 100", "found 100, expected at most 2"),
    ],
)
def test_what_nobody_means_is_refused_with_its_line(edited, old, new, message):
    path = edited(old, new)
    (finding,) = lint(path)
    assert message in finding.message
    assert finding.line == EXAMPLE.read_text()[: EXAMPLE.read_text().index(old)].count("\n") + 1
    assert not finding.warning


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("chains: 4", "max_r_hat: 1.5", "found 1.5, expected about 1.01"),
        ("chains: 4", "min_ess: 5", "found 5, expected about 400"),
        ("  conductors:\n", "    lone: {capacity: 5 J/K, initial: 3 degC}\n  conductors:\n", "its heat cannot leave"),
        (
            "environment:\n",
            "environment:\n  earth: {radius: 12756 km}\n",
            "found 12756 km, expected 6300 to 6500 km, as the Earth has it",
        ),
        ("column: I_SUN, unit", "column: [I_BUS, U_BUS], combine: product, unit", "or one driver of several loads"),
        ("environment:\n", "environment:\n  solar_constant: 950 W/m^2\n", "found 950 (SI), expected 1300 to 1420"),
        ("albedo: 0.3", "albedo: 0.03", "found 0.03 (SI), expected 0.05 to 0.9, as the Earth and the Sun have it"),
        ("column: [TT_RAD_A, TT_RAD_B], combine: mean", "column: TT_BAT", "found the column 'TT_BAT', which"),
        ("column: [TT_RAD_A, TT_RAD_B]", "column: [TT_RAD_A, TT_BAT]", "'battery_temp' reads too"),
    ],
)
def test_what_could_be_meant_is_a_warning_and_the_scenario_is_read(edited, old, new, message):
    path = edited(old, new)
    (finding,) = lint(path)
    assert finding.warning
    assert message in finding.message
    assert f"{finding.line}: warning: " in str(finding)
    assert load_scenario(path).name == "example"


def test_warnings_wait_until_nothing_is_wrong(edited):
    found = lint(edited("chains: 4", "max_r_hat: 1.5, chians: 4"))
    assert ["chians" in finding.message for finding in found] == [True]


def test_draws_that_do_not_fit_in_memory_are_refused_with_their_size(edited, monkeypatch):
    path = edited("chains: 4, draws: 1000", "chains: 100, draws: 1000000")
    monkeypatch.setattr(calibration, "physical_memory", lambda: 8.0 * 2**30)
    (finding,) = lint(path)
    assert "found 100 chains of 1000000 draws, which need" in finding.message
    assert "expected at most the 8 GiB of this machine" in finding.message


def test_lint_prints_warnings_and_passes(tmp_path):
    assert CliRunner().invoke(app, ["init", str(tmp_path / "mine")]).exit_code == 0
    path = tmp_path / "mine" / "scenario.yaml"
    path.write_text(path.read_text().replace("chains: 4,", "chains: 4, min_ess: 5,"))
    result = CliRunner().invoke(app, ["lint", str(path)])
    assert result.exit_code == 0, result.output
    assert "warning: calibration.nuts.min_ess: found 5" in result.output


def test_what_needs_more_memory_than_there_is_is_refused_with_its_size():
    require_memory(1.0, "nothing")
    with pytest.raises(FlightcalError, match=r"a grid: needs 9.31e\+08 GiB of memory, found"):
        require_memory(1e18, "a grid")
    assert memory_size(447 * 2**30) == "447 GiB"
