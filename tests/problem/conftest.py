"""Problems with unmodelled heat, made once for all modules."""

import numpy as np
import pytest

from flightcal.problem import at_sizes
from tests.problem.heated import in_place_of_another, middle, model_of, problem_of, with_some_heat, written


@pytest.fixture(scope="session")
def problem(tmp_path_factory):
    return problem_of(tmp_path_factory.mktemp("heat"))


@pytest.fixture(scope="session")
def unheated(tmp_path_factory):
    """Without heaters."""
    return problem_of(tmp_path_factory.mktemp("heat"), written(heaters=False))


@pytest.fixture(scope="session")
def model(problem):
    return model_of(problem)


@pytest.fixture(scope="session")
def centre(problem):
    return middle(problem)


@pytest.fixture(scope="session", params=["open loop", "two windows without heaters", "with an error"])
def both(request, tmp_path_factory):
    """Problem without heat and with it."""
    content = written(windows=1) if request.param == "open loop" else written(heaters=False)
    problem = problem_of(tmp_path_factory.mktemp("heat"), content)
    return with_some_heat(in_place_of_another(problem) if request.param == "with an error" else problem)


@pytest.fixture(scope="session")
def heated(both):
    return both[1]


@pytest.fixture(scope="session")
def at_centre(both):
    """z [d] of the problem with heat."""
    problem, heated = both
    known = dict(zip(problem.names, middle(problem), strict=True))
    theta = [known.get(name, median) for name, median in zip(heated.names, heated.priors.median(), strict=True)]
    return heated.to_z(np.array(theta))


@pytest.fixture(scope="session")
def known(heated, at_centre):
    """At known sizes."""
    return at_sizes(heated, heated.to_theta(at_centre))


@pytest.fixture(scope="session")
def at_known(heated, known, at_centre):
    return np.array([at_centre[heated.names.index(name)] for name in known.names])
