"""A run directory made up for the tests of the report: a toy satellite of three nodes with two thermostats.

The posterior is drawn around the truth instead of sampled; everything else is simulated with the toy, and telemetry
has a slow heat load that the toy does not know, so its residuals are autocorrelated as in flight.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import xarray as xr

from flightcal.prediction.holding import replicate
from flightcal.prediction.metrics import crps_of_draws, probability_below
from flightcal.report import Finding, Section, verdict_of
from flightcal.report.panels import first_screen, parts
from flightcal.report.run_files import RunFiles

CHANNELS = ["panel_temperature", "battery_temperature", "payload_temperature"]
HEATERS = ["battery_heater", "payload_heater"]
METHODS = ["uncalibrated", "poorly_calibrated", "genetic", "genetic_best", "calibrated", "stochastic"]
PERIOD = 5_800.0
STEP = 40.0
LOAD = 40.0
POWER = np.array([14.0, 9.0])
ON_BELOW, OFF_ABOVE = np.array([283.15, 278.15]), np.array([286.15, 280.65])
NOISE = np.array([0.25, 0.12, 0.15])

# name, unit, target, prior text, truth, prior low and high (95%), posterior standard deviation
PARAMETERS = [
    ("panel_absorptivity", "", "faces.panel.absorptivity", "uniform(0.2, 0.6)", 0.42, 0.21, 0.59, 0.004),
    ("panel_emissivity", "", "faces.panel.emissivity", "uniform(0.6, 0.95)", 0.80, 0.61, 0.94, 0.005),
    ("panel_capacity", "J/K", "nodes.panel.capacity", "lognormal(2500, 1.5)", 2600.0, 1100.0, 5600.0, 40.0),
    ("battery_capacity", "J/K", "nodes.battery.capacity", "lognormal(3000, 1.5)", 3500.0, 1350.0, 6650.0, 60.0),
    ("battery_link", "W/K", "conductors.panel-battery.conductance", "lognormal(0.5, 2)", 0.6, 0.13, 1.95, 0.012),
    ("payload_link", "W/K", "conductors.panel-payload.conductance", "lognormal(0.3, 2)", 0.35, 0.08, 1.2, 0.009),
    ("payload_capacity", "J/K", "nodes.payload.capacity", "uniform(1000, 2000)", 1995.0, 1025.0, 1975.0, 20.0),
    ("battery_threshold", "K", "heaters.battery_heater.on_below", "normal(283, 1)", 283.15, 281.0, 285.0, 0.08),
]  # fmt: skip


def simulate(theta: np.ndarray, initial: np.ndarray, seconds: np.ndarray, load: float = 0.0) -> tuple[np.ndarray, ...]:
    """Temperatures [S, T, 3] K and heater status [S, T, 2] of the toy, theta [S, 8], initial [S, 3] K."""
    absorptivity, emissivity, c_panel, c_battery, k_battery, k_payload, c_payload, threshold = theta.T
    x = initial.copy()
    on = np.zeros((len(theta), 2), bool)
    below = np.stack([threshold, np.full_like(threshold, ON_BELOW[1])], axis=1)
    temperatures, status = [], []
    for t in seconds:
        temperatures.append(x.copy())
        watched = x[:, 1:]
        on = np.where(watched <= below, True, np.where(watched >= OFF_ABOVE, False, on))
        status.append(on.copy())
        phase = 2 * np.pi * t / PERIOD
        sun = 1361.0 * max(np.cos(phase), 0.0) * 0.7 * sunlit(t) + 90.0
        to_battery, to_payload = k_battery * (x[:, 0] - x[:, 1]), k_payload * (x[:, 0] - x[:, 2])
        slow = load * np.sin(0.37 * phase + 1.0)
        rates = [
            (
                absorptivity * sun * 0.5
                - emissivity * 0.5 * 5.670374419e-8 * x[:, 0] ** 4
                - to_battery
                - to_payload
                + LOAD
            )
            / c_panel,
            (to_battery + on[:, 0] * POWER[0] + 1.0 + slow) / c_battery,
            (to_payload + on[:, 1] * POWER[1] + 1.0 - slow) / c_payload,
        ]
        x = x + STEP * np.stack(rates, axis=1)
    return np.stack(temperatures, axis=1), np.stack(status, axis=1).astype(float)


def sunlit(seconds: float) -> float:
    """1 in sunlight, 0 in eclipse, for 36% of the orbit around the anti-solar point."""
    return float(abs((seconds / PERIOD) % 1.0 - 0.5) > 0.18)


def every_finding(run: RunFiles) -> list[Finding]:
    """All that the verdict on a run says, in order."""
    judged = verdict_of(run)
    return [*(found for answer in judged.answers for found in answer.findings), *judged.beside]


def panels(run: RunFiles) -> list[Section]:
    """All sections of its page, those of the first screen first."""
    return [*first_screen(run), *(section for part in parts(run) for section in part.sections)]


def write_synthetic_run(folder: Path, seed: int = 1, orbits: float = 2.0, draws: int = 250) -> Path:
    """Writes all files of a run directory into `folder` and returns it."""
    rng = np.random.default_rng(seed)
    folder.mkdir(parents=True, exist_ok=True)
    truth = np.array([p[4] for p in PARAMETERS])
    low, high = np.array([p[5] for p in PARAMETERS]), np.array([p[6] for p in PARAMETERS])
    posterior = _posterior(truth, rng, draws)
    genetic = _genetic(truth, low, high, rng)
    genetic.to_netcdf(folder / "genetic.nc", engine="h5netcdf")

    thetas = {
        "uncalibrated": (low + high) / 2,
        "poorly_calibrated": truth + 0.12 * (high - low) * rng.choice([-1, 1], truth.size),
        "genetic": genetic["mean_theta"].values,
        "genetic_best": genetic["best_theta"].values,
        "calibrated": posterior.mean(axis=(0, 1))[: truth.size],
    }
    groups = {}
    for index, name in enumerate(["train", "test"]):
        start = np.datetime64("2024-03-01T00:00:00", "ns") + np.timedelta64(index * 26, "h")
        groups[name] = _window(start, orbits, truth, thetas, posterior, rng)
    groups["test"].attrs["unseen"] = "[]"
    xr.DataTree.from_dict(groups).to_netcdf(folder / "prediction.nc", engine="h5netcdf")
    _posterior_tree(posterior, groups["train"], low, high, rng).to_netcdf(folder / "posterior.nc", engine="h5netcdf")
    _write_texts(folder, posterior, low, high, groups)
    return folder


def names() -> list[str]:
    """All uncertain quantities: parameters, noise, initial temperatures."""
    nodes = ["panel", "battery", "payload"]
    return [p[0] for p in PARAMETERS] + [f"noise.{c}" for c in CHANNELS] + [f"initial.{n}" for n in nodes]


def _posterior(truth: np.ndarray, rng: np.random.Generator, draws: int) -> np.ndarray:
    """Draws [4, draw, quantity], with two correlated pairs and one quantity pressed against its prior's bound."""
    deviation = np.array([p[7] for p in PARAMETERS])
    z = rng.normal(size=(4, draws, truth.size))
    z[..., 1] = 0.92 * z[..., 0] + 0.39 * z[..., 1]
    z[..., 3] = -0.75 * z[..., 4] + 0.66 * z[..., 3]
    theta = truth + deviation * z
    theta[..., 6] = 2000.0 - np.abs(theta[..., 6] - 2000.0)
    noise = NOISE * 1.6 * np.exp(0.04 * rng.normal(size=(4, draws, 3)))
    initial = np.array([285.0, 284.0, 279.5]) + np.array([0.1, 0.05, 0.06]) * rng.normal(size=(4, draws, 3))
    return np.concatenate([theta, noise, initial], axis=-1)


def _genetic(truth: np.ndarray, low: np.ndarray, high: np.ndarray, rng: np.random.Generator) -> xr.Dataset:
    best = truth + 0.03 * (high - low) * rng.normal(size=(10, truth.size))
    final = 0.45 + 0.08 * rng.random(10)
    history = final[:, None] + np.exp(-np.arange(60)[None] / rng.uniform(6, 14, (10, 1))) * rng.uniform(4, 8, (10, 1))
    history = np.minimum.accumulate(history, axis=1)
    return xr.Dataset(
        {
            "best": (("run", "parameter"), best),
            "rmse": ("run", history[:, -1]),
            "generations": ("run", np.full(10, 60)),
            "converged": ("run", np.full(10, True)),
            "poor_theta": ("parameter", low),
            "history": (("run", "generation"), history),
            "mean_theta": ("parameter", best.mean(axis=0)),
            "best_theta": ("parameter", best[history[:, -1].argmin()]),
        },
        {"parameter": [p[0] for p in PARAMETERS], "unit": ("parameter", [p[1] or "1" for p in PARAMETERS])},
        {"seed": 1, "evaluations": 38_400, "failures": 0, "converged_runs": 10, "converged_when": "nothing falls"},
    )


def _window(
    start: np.datetime64, orbits: float, truth: np.ndarray, thetas: dict[str, np.ndarray],
    posterior: np.ndarray, rng: np.random.Generator,
) -> xr.Dataset:  # fmt: skip
    seconds = np.arange(0, orbits * PERIOD, STEP)
    initial = np.array([285.0, 284.0, 279.5])
    real, real_status = simulate(truth[None], initial[None], seconds, load=0.5)
    observed = real[0] + NOISE * rng.normal(size=real[0].shape)
    observed[rng.random(observed.shape) < 0.02] = np.nan
    observed[len(seconds) // 3 : len(seconds) // 3 + 9, 1] = np.nan
    status = real_status[0]
    chosen = posterior.reshape(-1, posterior.shape[-1])[rng.integers(0, posterior.shape[0] * posterior.shape[1], 200)]
    model, on = simulate(chosen[:, :8], chosen[:, 11:], seconds)
    whole = model + chosen[:, None, 8:11] * rng.normal(size=model.shape)
    point, point_on = simulate(np.stack(list(thetas.values())), np.repeat(initial[None], len(thetas), axis=0), seconds)
    nothing = np.full_like(point, np.nan)
    bounds = np.quantile(whole, [0.025, 0.975], axis=0)
    counts = np.abs(np.diff(on, axis=1)).sum(axis=1)
    point_counts = np.abs(np.diff(point_on, axis=1)).sum(axis=1)
    duration = orbits * PERIOD
    held = replicate(seconds, observed, seconds >= 600.0, whole, 0.95)
    all_methods = ("by", "time", "channel")
    return xr.Dataset(
        {
            "observed": (("time", "channel"), observed),
            "scored": ("time", seconds >= 600.0),
            "mean": (all_methods, np.concatenate([point, whole.mean(axis=0)[None]])),
            "lower": (all_methods, np.concatenate([nothing, bounds[:1]])),
            "upper": (all_methods, np.concatenate([nothing, bounds[1:]])),
            "standard_deviation": (all_methods, np.concatenate([nothing, whole.std(axis=0)[None]])),
            "model_lower": (("time", "channel"), np.quantile(model, 0.025, axis=0)),
            "model_upper": (("time", "channel"), np.quantile(model, 0.975, axis=0)),
            "lowest": (("simulation", "channel"), model[:, seconds >= 600.0].min(axis=1)),
            "highest": (("simulation", "channel"), model[:, seconds >= 600.0].max(axis=1)),
            "lower_limit": ("channel", np.full(model.shape[2], np.nan)),
            "upper_limit": ("channel", np.full(model.shape[2], np.nan)),
            "crps": (("time", "channel"), crps_of_draws(observed, whole)),
            "probability_below": (("time", "channel"), probability_below(observed, whole)),
            **held.dataset().variables,
            "observed_status": (("time", "heater"), status),
            "status": (("by", "time", "heater"), np.concatenate([point_on, on.mean(axis=0)[None]])),
            "duty_cycle": (("simulation", "heater"), on.mean(axis=1)),
            "sampled_duty_cycle": (("simulation", "heater"), on.mean(axis=1)),
            "unknown_status": ("heater", np.zeros(len(HEATERS))),
            "switch_count": (("simulation", "heater"), counts),
            "energy": (("simulation", "heater"), on.mean(axis=1) * POWER * duration),
            "point_duty_cycle": (("by", "heater"), np.vstack([point_on.mean(axis=1), on.mean(axis=(0, 1))])),
            "point_sampled_duty_cycle": (
                ("by", "heater"), np.vstack([point_on.mean(axis=1), on.mean(axis=(0, 1))])
            ),
            "point_switch_count": (("by", "heater"), np.vstack([point_counts, counts.mean(axis=0)])),
            "point_energy": (
                ("by", "heater"),
                np.vstack([point_on.mean(axis=1), on.mean(axis=(0, 1))]) * POWER * duration,
            ),
            "observed_duty_cycle": ("heater", status.mean(axis=0)),
            "observed_switch_count": ("heater", np.abs(np.diff(status, axis=0)).sum(axis=0)),
            "eclipse": ("time", [sunlit(t) for t in seconds]),
            "orbit_phase": ("time", (seconds / PERIOD) % 1.0),
        },
        {
            "time": start + (seconds * 1e9).astype("timedelta64[ns]"),
            "channel": CHANNELS, "heater": HEATERS, "by": METHODS,
        },
        {
            "interval": 0.95,
            "interval_contains": "parameters, initial temperatures and measurement noise; not model discrepancy",
            "model_interval_contains": "parameters, initial temperatures",
            "duty_cycle_contains": "parameters, initial temperatures",
            "initial_state": "estimated from the first 10 min of the window, which are not scored",
            "failed_simulations": 0,
        },
    )  # fmt: skip


def _posterior_tree(
    posterior: np.ndarray, train: xr.Dataset, low: np.ndarray, high: np.ndarray, rng: np.random.Generator
) -> xr.DataTree:
    chains, draws, _ = posterior.shape
    both = ("chain", "draw")
    centre, spread = _prior(low, high)
    prior = centre + spread * rng.uniform(-1.95, 1.95, (1, 2_000, centre.size))
    prior[..., 8:11] = np.abs(prior[..., 8:11])
    thin = max(1, draws // 60)
    predictive = np.repeat(train["mean"].values[None, None, -1], chains, 0).repeat(len(range(0, draws, thin)), 1)
    stats = {
        "diverging": (both, rng.random((chains, draws)) < 0.002),
        "depth": (both, rng.integers(2, 5, (chains, draws))),
        "n_steps": (both, rng.integers(3, 31, (chains, draws))),
        "energy": (both, rng.normal(size=(chains, draws))),
        "step_size": (both, np.full((chains, draws), 0.4)),
        "acceptance": (both, rng.uniform(0.7, 1.0, (chains, draws))),
        "log_density": (both, rng.normal(size=(chains, draws))),
    }
    tree = xr.DataTree.from_dict(
        {
            "posterior": xr.Dataset({n: (both, posterior[..., i]) for i, n in enumerate(names())}),
            "sample_stats": xr.Dataset(stats),
            "prior": xr.Dataset({n: (both, prior[..., i]) for i, n in enumerate(names())}),
            "posterior_predictive": xr.Dataset(
                {"temperature": ((*both, "time", "channel"), predictive)},
                {"time": train["time"], "channel": CHANNELS, "draw": np.arange(0, draws, thin)},
            ),
            "observed_data": xr.Dataset(
                {
                    "temperature": (("time", "channel"), train["observed"].values),
                    "status": (("time", "heater"), train["observed_status"].values),
                },
                {"time": train["time"], "channel": CHANNELS, "heater": HEATERS},
            ),
        }
    )
    tree.attrs = {
        "interrupted": "false",
        "mode_search": json.dumps(
            {
                "sought": "in open loop, and finished in closed loop",
                "modes": [{"origin": "open loop from prior draw 2", "log_density": -310.5, "converged": True}],
            }
        ),
        "other_explanations": "[]",
        "status_likelihood": json.dumps({"battery_htr": "switch times"}),
        "switch_sequences": json.dumps([{"window": "train", "sequences": 7, "share_of_most_common": 0.62}]),
    }
    return tree


def _prior(low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Centre and standard deviation of every quantity's prior."""
    centre = np.concatenate([(low + high) / 2, [1.35] * 3, [285.0, 284.0, 279.5]])
    return centre, np.concatenate([(high - low) / 3.9, [0.7] * 3, [2.0] * 3])


def _write_texts(
    folder: Path, posterior: np.ndarray, low: np.ndarray, high: np.ndarray, groups: dict[str, xr.Dataset]
) -> None:
    from dataclasses import asdict

    from flightcal.prediction import score

    def write(name: str, content: object) -> None:
        (folder / name).write_text(json.dumps(content, indent=1), encoding="utf-8")

    flat = posterior.reshape(-1, posterior.shape[-1])
    centre, spread = _prior(low, high)
    parameters, diagnosed, calibrated = [], [], []
    for i, name in enumerate(names()):
        kind = "noise" if name.startswith("noise.") else "initial" if name.startswith("initial.") else "parameter"
        unit = PARAMETERS[i][1] if kind == "parameter" else "K"
        target = [PARAMETERS[i][2]] if kind == "parameter" else []
        text = PARAMETERS[i][3] if kind == "parameter" else "half_normal(2)" if kind == "noise" else "normal"
        quantiles = [max(centre[i] - 1.95 * spread[i], 0.0), centre[i], centre[i] + 1.95 * spread[i]]
        mode = "sets" if kind == "parameter" else ""
        parameters.append(
            {"name": name, "kind": kind, "unit": unit, "target": target, "mode": mode, "prior": text,
             "prior_quantiles": quantiles, "observed": True}
        )  # fmt: skip
        q = np.quantile(flat[:, i], [0.025, 0.5, 0.975])
        diagnosed.append(
            {"name": name, "mean": flat[:, i].mean(), "sd": flat[:, i].std(), "q2_5": q[0], "median": q[1],
             "q97_5": q[2], "r_hat": 1.001 + 0.0005 * i, "ess_bulk": 900.0 - 20 * i, "ess_tail": 700.0 - 10 * i,
             "mcse_mean": flat[:, i].std() / 30, "prior_score": 0.5 * (-1.0) ** i, "usual_score": 0.9}
        )  # fmt: skip
        is_absolute = kind == "initial" or name == "battery_threshold"
        offset = -273.15 if is_absolute else 0.0
        of_prior = dict(
            zip(("before_lower", "before", "before_upper"), (np.array(quantiles) + offset).tolist(), strict=True)
        )
        after = dict(zip(("lower", "median", "upper"), (q + offset).tolist(), strict=True))
        calibrated.append(
            {"name": name, "kind": kind, "unit": "degC" if is_absolute else unit, **of_prior, **after,
             "mean": flat[:, i].mean() + offset, "deviation": flat[:, i].std(),
             "considered_lower": after["lower"] - flat[:, i].std(),
             "considered_upper": after["upper"] + flat[:, i].std(),
             "from_data": max(0.0, 1.0 - (flat[:, i].std() / spread[i]) ** 2)}
        )  # fmt: skip
    write("priors.json", parameters)
    write(
        "parameters.json",
        {"interval": 0.95, "parameters": calibrated, "fixed_numbers": {"within": 0.1, "footings": []}},
    )
    gates = [
        {"name": name, "passed": passed, "found": found, "required": required, "advice": advice}
        for name, passed, found, required, advice in (
            ("R-hat", True, "1.008 (initial.payload)", "below 1.01", ""),
            ("effective draws", True, "640 (initial.payload)", "above 400", ""),
            ("effective draws, tails", True, "570 (initial.payload)", "above 400", ""),
            ("divergences", False, "2 of 1000 draws", "none", "Raise the acceptance (nuts: target_acceptance)."),
            ("trajectory length", True, "0.0% cut at depth 10", "at most 1%", ""),
            ("E-BFMI", True, "0.91", "above 0.3", ""),
        )
    ]
    write(
        "diagnostics.json",
        {"parameters": diagnosed, "gates": gates, "passed": False, "gradient_evaluations": 31_250,
         "verdict": "Not converged: do not rely on this posterior. divergences: found 2 of 1000 draws, required none."},
    )  # fmt: skip
    write("metrics.json", [asdict(m) for name, group in groups.items() for m in score(group, name)])
    write(
        "telemetry_quality.json",
        [{"channel": "", "finding": "gaps", "samples": 9, "share": 0.031, "first": "2024-03-01T01:04:20",
          "last": "2024-03-01T01:09:40", "detail": "1 gap: 360 s from 2024-03-01T01:04:20"},
         {"channel": "battery_temperature", "finding": "missing", "samples": 18, "share": 0.031,
          "first": "2024-03-01T01:04:20", "last": "2024-03-01T01:09:40", "detail": "longest gap 360 s"},
         {"channel": "panel_temperature", "finding": "out_of_range", "samples": 2, "share": 0.003,
          "first": "2024-03-01T02:00:00", "last": "2024-03-01T02:00:40", "detail": "found 185 degC"}],
    )  # fmt: skip
    write("integration.json", [{"window": "train", "steps": 96, "error": 0.0031, "largest": 0.0124}])
    write(
        "provenance.json",
        {"flightcal": "0.1.0", "python": "3.11.9", "packages": {"numpy": "2.4.6", "jax": "0.10.2"},
         "inputs": {"scenario.yaml": "9f" * 32, "telemetry.csv": "a1" * 32}, "seed": 1,
         "stages": {"read": 0.4, "genetic": 21.3, "nuts": 42.5, "predict": 3.1},
         "identity": "c3" * 32, "parts": {"the scenario": "d4" * 32}, "stage_inputs": {},
         "created": "2024-05-02T09:30:00+00:00", "machine": {"cpu_count": 4, "platform": "Linux x86_64"}},
    )  # fmt: skip
    (folder / "scenario.yaml").write_text(
        "name: Toy <satellite> & friends\ndescription: Two heaters\n", encoding="utf-8"
    )
