"""What was found in telemetry with heat, once for all modules."""

import pytest

from flightcal.calibration.find_heat import find_heat
from flightcal.calibration.heat_point import start_with_heat
from flightcal.problem import at_sizes
from tests.calibration.heated import CASES, pattern, problem_of


@pytest.fixture(scope="session", params=CASES)
def found(request, tmp_path_factory):
    """Telemetry with heat in the panel alone, and what was found in it."""
    problem = problem_of(tmp_path_factory.mktemp("heat"), CASES[request.param], panel=pattern)
    return problem, find_heat(problem, problem.priors.median())


@pytest.fixture(scope="session")
def started(found):
    """Problems without heat, with it, and at known sizes, with what was found and where to begin."""
    problem, point = found
    heated, z = start_with_heat(problem, point)
    return problem, point, heated, z, at_sizes(heated, heated.to_theta(z))


@pytest.fixture(scope="session")
def without_heaters(tmp_path_factory):
    return problem_of(tmp_path_factory.mktemp("heat"), CASES["without heaters"], panel=pattern)
