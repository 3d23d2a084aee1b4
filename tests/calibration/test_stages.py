"""What the stages of a calibration say before they begin."""

from flightcal.calibration import GENETIC, NUTS
from flightcal.problem import build_problem
from flightcal.run import Run, open_run
from flightcal.scenario import GeneticSettings, NutsSettings
from tests import small
from tests.told import Told


def test_each_stage_says_first_how_long_it_will_take(tmp_path):
    problem = build_problem(*small.closed_loop(tmp_path, small.content()))
    told = Told()
    with open_run(tmp_path / "run", {}, "name: x", {}, 1) as folder:
        run = Run(folder, told)
        run.given("of the problem", problem)
        found = run.stage(GENETIC, problem, settings=GeneticSettings(runs=1, population=8, generations=2), seed=1)
        assert len(told.said) == 1
        assert told.said[0].startswith("genetic algorithm: about ")
        run.stage(NUTS, problem, found, settings=NutsSettings(chains=2, draws=50, warmup=50, min_ess=1), seed=1)
        assert told.said[1].startswith("stochastic update: about ")
