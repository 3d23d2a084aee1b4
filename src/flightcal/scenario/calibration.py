"""Settings of the methods: the blocks of `calibration`."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from .fields import Block, Count, Number
from .units import Duration


class GeneticSettings(Block):
    """The genetic algorithm; a run ends when it has converged."""

    runs: Count = Field(10, ge=1, le=1000)
    population: Count = Field(64, ge=8, le=100_000)
    generations: Count = Field(1000, ge=1, le=100_000)
    """Of a run, at most."""
    heater_status_weight: Number = Field(0.0, ge=0)
    """Kelvin that a status sample simulated wrongly counts as in the RMSE; 0: temperatures only."""


class NutsSettings(Block):
    """The No-U-Turn sampler and the gates its result must pass."""

    chains: Count = Field(4, ge=2, le=100)
    draws: Count = Field(400, ge=50, le=1_000_000)
    """Of each chain; up to eight times as many are made where otherwise too few are effective."""
    warmup: Count = Field(250, ge=50, le=1_000_000)
    target_acceptance: Number = Field(0.85, gt=0.5, lt=1)
    max_r_hat: Number = Field(1.01, gt=1, le=2)
    min_ess: Number = Field(400, gt=0)


class EmulatorSettings(Block):
    """The emulator of a simulator without derivatives, and the real runs that it is made from."""

    runs: Count = Field(300, ge=40, le=1_000_000)
    """Budget of real runs of all training windows together; failed ones count, and the last check does."""
    start: Count | None = Field(None, ge=10, le=1_000_000)
    """Runs of the start design through the priors (default: ten for each parameter)."""
    batch: Count | None = Field(None, ge=1, le=1_000_000)
    """Runs that a round adds (default: four for each parameter)."""
    shift: Number = Field(0.1, gt=0)
    """By how many standard deviations the emulator's error, or a further round, may still shift the posterior."""


class PredictionSettings(Block):
    """Propagation of the posterior."""

    simulations: Count = Field(1000, ge=20, le=100_000)
    interval: Number = Field(0.95, gt=0, lt=1)
    initial_span: Duration = 600.0
    """The first samples of an unseen window, used for its initial temperatures and never scored."""


class Calibration(Block):
    """Settings of the methods."""

    seed: Annotated[Count, Field(ge=0, lt=2**32)] = 1
    genetic: GeneticSettings = GeneticSettings()
    nuts: NutsSettings = NutsSettings()
    prediction: PredictionSettings = PredictionSettings()
    emulator: EmulatorSettings = EmulatorSettings()
    fixed_numbers_within: Number = Field(0.1, gt=0, lt=1)
    """Relative deviation by which capacities, areas, links and the like that are no parameters may be off."""
