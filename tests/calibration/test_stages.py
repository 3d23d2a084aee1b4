"""What the stages of a calibration say before they begin."""

from time import sleep
from types import SimpleNamespace

import numpy as np

from flightcal.calibration import GENETIC, NUTS
from flightcal.calibration.stages import rough_search_seconds
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


def test_what_the_first_simulation_alone_takes_is_not_counted_for_every_other():
    waits = [0.2]

    def rmse(thetas):
        sleep(waits.pop() if waits else 0.0)
        return np.ones(len(thetas))

    priors = SimpleNamespace(sample=lambda rng, count: rng.random((count, 1)))
    settings = GeneticSettings(runs=1, population=640, generations=100)
    assert rough_search_seconds(SimpleNamespace(priors=priors, rmse=rmse), settings) < 10.0
