"""What a calibration says before it begins."""

from flightcal.calibration import COMPILE
from flightcal.problem import build_problem
from flightcal.run import Run, open_run
from tests import small
from tests.told import Told


def test_before_the_genetic_algorithm_it_is_said_how_long_the_rest_takes(tmp_path):
    problem = build_problem(*small.closed_loop(tmp_path, small.content()))
    told = Told()
    with open_run(tmp_path / "run", {}, "name: x", {}, 1) as folder:
        run = Run(folder, told)
        run.given("of the problem", problem)
        run.stage(COMPILE, problem)
    (line,) = told.said
    assert line.startswith("to come: genetic algorithm, about ")
    assert "; stochastic update, about " in line
