"""What tests of several families share."""

import pytest

from flightcal.check import white_box, wrongs

from ..cases import named


@pytest.fixture(params=["few", pytest.param("all", marks=pytest.mark.slow)])
def named_of(request):
    """As `named`, where only wrongs of some families are tried, in a third of the time; in slow tests all of them.

    Each family has a fast test beside all others too.
    """

    def look(scenario, data, *families):
        with pytest.MonkeyPatch.context() as patch:
            if request.param == "few":
                patch.setattr(
                    wrongs, "_WRONGS", tuple(tried for family in families for tried in getattr(wrongs, family).WRONGS)
                )
                patch.setattr(white_box, "_by_what_is_left", lambda *_: iter(()))
            return named(scenario, data)

    return look
