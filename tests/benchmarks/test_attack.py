"""The campaigns of `make attack` can be begun."""

from benchmarks.attack.__main__ import campaigns


def test_every_campaign_is_run():
    assert [campaign.__name__.rpartition(".")[2] for campaign in campaigns()] == [
        "inputs",
        "setups",
        "storage",
        "verdicts",
    ]
