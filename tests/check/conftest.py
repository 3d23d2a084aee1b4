"""What tests of several files share."""

import pytest

from tests import small


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """A scenario and the telemetry of its own model."""
    return small.closed_loop(tmp_path_factory.mktemp("flown"))
