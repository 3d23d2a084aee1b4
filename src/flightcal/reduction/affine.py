"""A network's heat balance as a sum of constant matrices times products of what parameters change.

In watts, node by node,

    C dT/dt = sum_k p_k(theta) (L_k T + R_k T^4 + B_k w + sum_h u_h g_kh),     C = sum_k p_k(theta) C_k,

where p_k is a product of *free numbers*: the parameters, and those of the scenario's numbers that stay what they are
in any reduced model (heaters, modes, environment). Products that no parameter touches are folded into the constants.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.sparse import csr_matrix

from ..scenario import Scenario, numbers_of
from ..simulator import FloatArray, Network, Structure

Product = tuple[int, ...]
"""Positions of free numbers, ascending, with repetition."""
Kind = Literal["linear", "radiative", "forcing", "heating"]

KEPT = ("heaters.", "modes.", "environment.")
"""Numbers of the scenario that are free numbers themselves."""


@dataclass(frozen=True)
class Affine:
    """The matrices of each product, of a network of n states with q input series and H heaters."""

    free: tuple[str, ...]
    """Names of the free numbers: ``reduced.<parameter>`` of those that a matrix depends on, and dotted paths."""
    values: FloatArray
    """Of the free numbers, SI: prior medians, and what the scenario writes."""
    matrices: dict[Kind, dict[Product, csr_matrix]]
    """linear and radiative [n, n], forcing [n, q], heating [n, H]."""
    capacity: dict[Product, FloatArray]
    """[n] J/K."""


def decompose(network: Network, scenario: Scenario, medians: FloatArray) -> Affine:
    """The matrices of a scenario's network; medians [d] of its parameters."""
    numbers, free, values = _free_numbers(network, scenario, medians)
    terms, structure = network.terms, network.structure
    places = _places(structure)
    collected: dict[Kind, dict[Product, list[tuple[int, int, float]]]] = {
        kind: defaultdict(list) for kind in ("linear", "radiative", "forcing", "heating")
    }
    for t in range(len(terms.entry)):
        entry = int(terms.entry[t])
        if entry >= len(places):  # a threshold: free numbers as they are
            continue
        constant, product = float(terms.constant[t]), list[int]()
        for factor in terms.factors[t]:
            # The reciprocal of the row's capacity is left out: rows are in watts here.
            if factor < len(network.paths):
                coefficient, more = numbers[factor]
                constant *= coefficient
                product += more
        kind, row, column = places[entry]
        collected[kind][tuple(sorted(product))].append((row, column, constant))
    n = len(network.nodes)
    width = {"linear": n, "radiative": n, "forcing": len(network.columns), "heating": len(network.heaters)}
    matrices = {
        kind: {
            product: csr_matrix(
                ([v for _, _, v in entries], ([i for i, _, _ in entries], [j for _, j, _ in entries])),
                shape=(n, width[kind]),
            )
            for product, entries in sorted(found.items())
        }
        for kind, found in collected.items()
    }
    capacity: dict[Product, FloatArray] = {}
    for state, name in enumerate(network.nodes):
        if structure.mass[state] > 0.0:
            coefficient, more = numbers[network.position(f"nodes.{name}.capacity")]
            capacity.setdefault(tuple(sorted(more)), np.zeros(n))[state] = coefficient
    return Affine(free, values, matrices, dict(sorted(capacity.items())))


def product_of(values: FloatArray, product: Product) -> float:
    """The product of the free numbers `values` at its positions."""
    return float(np.prod([values[k] for k in product]))


def _free_numbers(
    network: Network, scenario: Scenario, medians: FloatArray
) -> tuple[list[tuple[float, list[int]]], tuple[str, ...], FloatArray]:
    """Every number of the network as a coefficient times free numbers; the free numbers' names and values."""
    parameters = list(scenario.parameters.items())
    written = dict(zip(network.paths, network.values.tolist(), strict=True))
    theta = numbers_of(written, [(parameter.sets, parameter.scales) for _, parameter in parameters])
    free = {
        f"reduced.{name}": float(median)
        for (name, parameter), median in zip(parameters, medians, strict=True)
        if any(not path.startswith(KEPT) for path in (*parameter.sets, *parameter.scales))
    }
    free |= {path: value for path, value in written.items() if path.startswith(KEPT)}
    place = {name: k for k, name in enumerate(free)}
    is_set = set(theta.sets[:, 0].tolist())
    numbers: list[tuple[float, list[int]]] = [
        (1.0, [place[path]]) if path in place else (1.0 if k in is_set else value, [])
        for k, (path, value) in enumerate(written.items())
    ]
    for position, entry in [*theta.sets.tolist(), *theta.scales.tolist()]:
        if network.paths[position] not in place:
            numbers[position][1].append(place[f"reduced.{parameters[entry][0]}"])
    return numbers, tuple(free), np.array(list(free.values()))


def _places(structure: Structure) -> list[tuple[Kind, int, int]]:
    """(kind, row, column) of every entry of a packed system, thresholds excepted."""
    n = len(structure.mass)
    places: list[tuple[Kind, int, int]] = []
    for kind in ("linear", "radiative"):
        start = getattr(structure, f"{kind}_start").astype(np.int64)
        rows = np.repeat(np.arange(n), np.diff(start))
        columns = getattr(structure, f"{kind}_column")
        places += [(kind, int(i), int(j)) for i, j in zip(rows, columns, strict=True)]
    places += [
        ("forcing", int(i), int(j)) for i, j in zip(structure.forcing_row, structure.forcing_column, strict=True)
    ]
    places += [
        ("heating", int(i), int(h)) for h, i in zip(structure.heating_heater, structure.heating_row, strict=True)
    ]
    return places
