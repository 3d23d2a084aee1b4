"""The peers of the benchmarks solve the same equations as flightcal; and the tools that compare them."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2]))

from benchmarks.canonical import canonical
from benchmarks.networks import chain, plate
from benchmarks.peers import c_program, scipy_ode
from benchmarks.problem import benchmark_problem
from benchmarks.report import DataMissingError, Section, Table

from benchmarks import __main__ as benchmarks_main
from benchmarks import timing
from flightcal.simulator import integrate

needs_gcc = pytest.mark.skipif(not c_program.compiler_version(), reason="no gcc")


@pytest.mark.slow
def test_the_peers_get_flightcals_system_and_log_density():
    problem, theta = benchmark_problem()
    model = canonical(problem)
    trajectory = problem.windows[0].simulate(theta)
    assert len(trajectory.switches.time) >= 4
    z = problem.to_z(theta)
    np.testing.assert_allclose(model.to_theta(z), theta, rtol=1e-9)
    for found, expected in zip(
        model.system(theta), model.simulator.system(theta[problem.windows[0].simulated]), strict=True
    ):
        np.testing.assert_allclose(found, expected, rtol=1e-12)
    assert model.log_density(z, lambda _: trajectory.temperatures) == pytest.approx(problem.log_density(z), rel=1e-10)


@needs_gcc
@pytest.mark.parametrize("case", [chain(12, heaters=3), plate(16)], ids=["chain", "plate"])
def test_the_c_program_agrees_with_flightcal(case):
    run = integrate(*case)
    assert len(run.switches.time) > 0
    np.testing.assert_allclose(c_program.forward(*case)(), run.states, rtol=0, atol=1e-6)


def test_scipy_with_events_agrees_with_flightcal():
    problem, theta = benchmark_problem()
    model = canonical(problem)
    exact = replace(model, drive=model.exact)
    found = exact.observe(scipy_ode.solve_with_events(exact, theta, "LSODA", 1e-7, 1e-5))
    np.testing.assert_allclose(found, problem.windows[0].simulate(theta).temperatures, rtol=0, atol=0.03)


def test_timings_take_turns():
    calls = []
    timings = timing.interleaved({"a": lambda: calls.append("a"), "b": lambda: calls.append("b")}, 3)
    assert {name: len(found.samples) for name, found in timings.items()} == {"a": 3, "b": 3}
    assert "".join(dict.fromkeys(calls)) == "ab"
    assert timing.ratios(timings, "a")["a"].median == 1.0


def test_the_exponent_of_a_power_law_is_found():
    sizes = [1, 2, 4, 8, 16, 32]
    assert timing.exponent(sizes, [0.1 * size**1.5 for size in sizes]) == pytest.approx(1.5)


def test_a_constant_leaves_the_exponent_of_the_larger_half_nearly_alone():
    sizes = [1, 2, 4, 8, 16, 32]
    times = [1.0 + size for size in sizes]
    assert timing.larger_half(sizes) == [8, 16, 32]
    assert timing.exponent(sizes, times) < 0.85 < timing.exponent(timing.larger_half(sizes), timing.larger_half(times))


def test_a_section_is_markdown():
    section = Section("Title", "Question.", [Table(["", "time"], [["a", "1 s"]])], ["Note."])
    assert section.markdown() == "## Title\n\nQuestion.\n\n|  | time |\n| --- | ---: |\n| a | 1 s |\n\n- Note."


def test_a_table_whose_data_are_missing_is_skipped_with_the_reason_and_stays_in_the_document(
    tmp_path, monkeypatch, capsys
):
    def measure(quick):
        raise DataMissingError("the telemetry is not there")

    document = tmp_path / "benchmarks.md"
    document.write_text("# Benchmarks\n\n## Forecasts\n\nOf before.\n", encoding="utf-8")
    monkeypatch.setattr(benchmarks_main, "_table", lambda name: measure)
    monkeypatch.setattr(sys, "argv", ["benchmarks", "--only", "forecast", "--out", str(document)])
    assert benchmarks_main.main() == 0
    assert "forecast: skipped: the telemetry is not there" in capsys.readouterr().out
    assert document.read_text(encoding="utf-8").endswith("## Forecasts\n\nOf before.\n")
