"""Tables of the benchmarks that need no peer can be measured."""

import pytest
from benchmarks.__main__ import TABLES, _table

SLOW = ("reduced", "residuals", "scaling")


@pytest.mark.parametrize("name", [*(pytest.param(name, marks=pytest.mark.slow) for name in SLOW), "batch", "genetic"])
def test_a_table_is_measured(name):
    assert name in TABLES
    section = _table(name)(True)
    assert section.tables
    assert all(table.rows for table in section.tables)
    assert "inf" not in section.markdown().split()
