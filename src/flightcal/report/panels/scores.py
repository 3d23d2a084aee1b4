"""Scores of the methods: the two side by side, by channel, and every one in full."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import chain

from ...prediction import GENETIC_RUNS, Metric, comparison_table, values_of
from ...words import count, number, percent
from .. import block
from ..block import Block, section
from ..run_files import RunFiles
from ..style import method
from ..tables import Cell, Table

_ERRORS = {"rmse": "RMSE, K", "mape_kelvin": "MAPE, % of kelvin", "mape_celsius": "MAPE, % of °C", "crps": "CRPS, K"}


@section("scores", "Scores")
def panel(run: RunFiles) -> list[Block]:
    """Scores of the two methods, side by side and in full."""
    if not run.metrics:
        return [block.note("There are no scores in this run (metrics.json).")]
    return [
        block.text(
            "Genetic algorithm (GA, mean of its runs as published) against the stochastic update (posterior mean), "
            "over all channels. A ratio below one (↓) says that the stochastic one is better. The paper's ratios are "
            "0.1014/0.1346 = 0.753 for RMSE and 0.054/0.061 = 0.885 for MAPE; its temperatures are masked, so that "
            "only ratios compare. A mean of runs can leave the ridge of good fits, so the best run stands beside it: "
            "it is what a good optimiser reaches, and the ratio to it is the fair one. Where that ratio is near one, "
            "the stochastic update predicts no better on average. What it then adds: intervals that say how far each "
            "temperature and duty cycle may be off, how well each parameter is known, and how they are correlated."
        ),
        *([block.text(words)] if (words := runs_in_words(run.metrics)) else []),
        *(block.text(f"{record['detail']}.") for record in run.quality or () if record["finding"] == "bridged"),
        block.table(comparison(run.metrics), "There is no pair of methods to compare."),
        *others(run),
        block.heading("By window and channel"),
        block.table(by_channel(run.metrics)),
        block.folded("Every score of every method", all_scores(run.metrics)),
        block.text(
            "Only samples that were not used for the initial state count. PICP: share of telemetry inside the "
            f"{run.interval}; MPIW: mean width of that interval; CRPS: continuous ranked probability score, for a "
            "point method its mean absolute error. MAPE in °C is undefined (–) where telemetry comes within 1 °C of "
            "0 °C."
        ),
    ]


def runs_in_words(metrics: Sequence[Metric]) -> str:
    """How many runs of the genetic algorithm converged, and how far they differ; "" where that is not known."""
    of_runs = [m for m in metrics if m.method == GENETIC_RUNS and m.channel == "all"]
    converged = next((m for m in of_runs if m.metric == "converged"), None)
    words = "" if converged is None else f"Genetic algorithm: {count(converged.value)} {_converged(converged)}."
    for window in dict.fromkeys(m.window for m in of_runs if m.metric == "rmse_lowest"):
        error = {m.metric: m.value for m in of_runs if m.window == window}
        words += (
            f" RMSE of single runs in “{window}”: {number(error['rmse_lowest'], 3)} to "
            f"{number(error['rmse_highest'], 3)} K, median {number(error['rmse_median'], 3)} K."
        )
    return words.strip()


def _converged(metric: Metric) -> str:
    runs, _, when = metric.note.partition("; ")
    return f"{runs} converged (a run has converged when {when})"


_OTHERS = {
    "published": "The published model has independent noise and no term for what the simulator lacks.",
    "reduced": (
        "The reduced model stands for the full simulator. It knows all of the satellite but its parameters, its "
        "sensors' biases and its failures, and it has unmodelled heat as well."
    ),
}
"""What is said of the models beside which a run can stand."""


def others(run: RunFiles) -> list[Block]:
    """The same satellite calibrated in other ways, beside this run; nothing where that was not made."""
    if not run.beside:
        return []
    words = (
        f"{' '.join(_OTHERS[model] for model in run.beside if model in _OTHERS)} All were calibrated on the same "
        f"telemetry. A coverage (PICP) near {100 * run.nominal:g}% is right; all other scores are better when smaller."
    )
    found = [block.heading("Beside other models"), block.text(words), block.table(beside(run))]
    return [*found, block.table(beside_by_channel(run))] if any(m.channel != "all" for m in run.metrics) else found


def _models(run: RunFiles) -> dict[str, Sequence[Metric]]:
    """Scores by what the columns are called: the published model, this run, then the others."""
    first = {f"{model} model": metrics for model, metrics in run.beside.items() if model == "published"}
    rest = {f"{model} model": metrics for model, metrics in run.beside.items() if model != "published"}
    return {**first, "this run": run.metrics, **rest}


def beside(run: RunFiles) -> Table:
    """Scores over all channels: genetic algorithm, and every model; a row for each window and score."""
    names = _ERRORS | {"picp": "PICP", "mpiw": "MPIW, K"}
    genetic = values_of(chain(*run.beside.values(), run.metrics))
    models = {title: values_of(model) for title, model in _models(run).items()}
    rows = []
    for window, metric in dict.fromkeys((m.window, m.metric) for m in run.metrics if m.metric in names):
        place = (window, "all", metric)
        values = [genetic.get(("genetic", *place)), *(model.get(("stochastic", *place)) for model in models.values())]
        shown = [percent(value) if metric == "picp" else number(value) for value in values]
        rows.append([window, names[metric], *shown])
    header = ("window", "score", "genetic algorithm, mean of its runs", *models)
    return Table(header, rows, range(2, len(header)))


def beside_by_channel(run: RunFiles) -> Table:
    """RMSE and coverage of every model, a row for each window and channel."""
    models = {title: values_of(model) for title, model in _models(run).items()}
    rows = [
        [
            *place,
            *(number(model.get(("stochastic", *place, "rmse")), 3) for model in models.values()),
            *(percent(model.get(("stochastic", *place, "picp"))) for model in models.values()),
        ]
        for place in _places(run.metrics)
    ]
    groups = (("", 2), ("RMSE, K", len(models)), (f"covered by the {run.interval}", len(models)))
    header = ("window", "channel", *models, *models)
    return Table(header, rows, range(2, len(header)), groups)


def comparison(metrics: Sequence[Metric]) -> Table:
    """Genetic against stochastic over all channels: mean and best of the runs, and the paper's ratios."""
    rows = []
    for row in (r for r in comparison_table(metrics) if r.channel == "all"):
        ratio: str = "–"
        if row.ratio is not None:
            mark, state = ("↓", "good") if row.ratio < 1 else ("↑", "warn")
            ratio = Cell(f"{number(row.ratio, 3)} {mark}", state)
        note = f"\n{row.note.replace('degC', '°C')}" if row.note else ""
        rows.append(
            [row.window, _ERRORS[row.metric] + note, number(row.genetic), number(row.stochastic),
             ratio, number(row.published, 3), number(row.genetic_best), number(row.ratio_best, 3)]
        )  # fmt: skip
    header = (
        "window", "score", "GA mean", "stochastic", "stoch. / GA mean", "same in the paper", "GA best",
        "stoch. / GA best",
    )  # fmt: skip
    return Table(header, rows, range(2, 8))


def by_channel(metrics: Sequence[Metric]) -> Table:
    """Temperature scores with a row for each window and channel, all channels first: methods beside each other."""
    found = values_of(metrics)
    methods = list(dict.fromkeys(m.method for m in metrics if m.metric == "rmse"))
    ratios = {(row.window, row.channel): row for row in comparison_table(metrics) if row.metric == "rmse"}
    rows = []
    for place in _places(metrics):

        def value(method: str, metric: str, place: tuple[str, str] = place) -> float | None:
            return found.get((method, *place, metric))

        def pair(metric: str, value: Callable[[str, str], float | None] = value) -> str:
            return f"{number(value('genetic', metric), 3)} / {number(value('stochastic', metric), 3)}"

        comparison = ratios.get(place)
        rows.append(
            [*place, *(number(value(method, "rmse"), 3) for method in methods),
             number(comparison.ratio if comparison else None, 3),
             number(comparison.ratio_best if comparison else None, 3),
             percent(value("stochastic", "picp")), number(value("stochastic", "mpiw"), 3), pair("crps"),
             pair("mape_kelvin"), pair("mape_celsius")]
        )  # fmt: skip
    header = (
        "window", "channel", *(method(name).short for name in methods), "stoch. / GA mean", "stoch. / GA best",
        "PICP", "MPIW, K", "CRPS, K", "MAPE, % of K", "MAPE, % of °C",
    )  # fmt: skip
    groups = (("", 2), ("RMSE, K", len(methods) + 2), ("interval", 2), ("GA mean / stochastic", 3))
    return Table(header, rows, range(2, len(header)), groups)


def _places(metrics: Sequence[Metric]) -> list[tuple[str, str]]:
    """Windows and channels with temperature scores, all channels first."""
    places = dict.fromkeys((m.window, m.channel) for m in metrics if m.metric == "rmse")
    windows = list(dict.fromkeys(window for window, _ in places))
    return sorted(places, key=lambda place: (windows.index(place[0]), place[1] != "all"))


def all_scores(metrics: Sequence[Metric]) -> Table:
    """Every temperature score: a row for each window, channel and method."""
    names = ("rmse", "mape_kelvin", "mape_celsius", "crps", "picp", "mpiw")
    found = values_of(metrics)
    methods = list(dict.fromkeys(m.method for m in metrics))
    rows = [
        [*place, method(label).title, *(number(found.get((label, *place, name))) for name in names)]
        for place in _places(metrics)
        for label in methods
        if (label, *place, "rmse") in found
    ]
    header = (
        "window", "channel", "method", "RMSE, K", "MAPE, % of K", "MAPE, % of °C", "CRPS, K", "PICP, share", "MPIW, K",
    )  # fmt: skip
    return Table(header, rows, range(3, 9))
