"""Groups of nodes that behave alike, by what they do in runs of the full network."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..simulator.system import FloatArray


def merge_alike(
    temperatures: FloatArray, capacity: FloatArray, kind: Sequence[object], fixed: Sequence[int], size: int
) -> list[list[int]]:
    """Groups of nodes [n]: the two nearest groups are merged until `size` are left, or none may be merged.

    temperatures: snapshots [s, n]. Nearness is Ward's (1963, J. Am. Stat. Assoc. 58, 236-244) with heat capacities
    [n] as weights: merging adds the least to the squared distance of nodes from their group's mean. Nodes of different
    `kind` [n] are never merged, and those in `fixed` with none.
    """
    count = temperatures.shape[1]
    weight = np.maximum(capacity, 1e-6 * capacity.max())
    # Distances between groups follow from those between nodes (Lance & Williams), so snapshots are used once.
    squares = np.einsum("sn,sn->n", temperatures, temperatures)
    apart = np.maximum(squares[:, None] + squares[None] - 2.0 * temperatures.T @ temperatures, 0.0)
    cost = apart * (weight[:, None] * weight[None] / (weight[:, None] + weight[None])) / len(temperatures)
    kinds = {item: k for k, item in enumerate(dict.fromkeys(kind))}
    label = np.array([kinds[item] for item in kind])
    cost[label[:, None] != label[None]] = np.inf
    cost[list(fixed)] = np.inf
    cost[:, list(fixed)] = np.inf
    np.fill_diagonal(cost, np.inf)
    groups: dict[int, list[int]] = {k: [k] for k in range(count)}
    while len(groups) > size:
        i, j = sorted(divmod(int(np.argmin(cost)), count))
        if not np.isfinite(cost[i, j]):
            break
        others = np.isfinite(cost[i])
        total = weight[i] + weight[j]
        merged = ((weight[i] + weight) * cost[i] + (weight[j] + weight) * cost[j] - weight * cost[i, j]) / (
            total + weight
        )
        merged[~others] = np.inf
        merged[i] = np.inf
        merged[j] = np.inf
        cost[i] = cost[:, i] = merged
        cost[j] = cost[:, j] = np.inf
        weight[i] = total
        groups[i] += groups.pop(j)
    return list(groups.values())


def name_groups(groups: Sequence[Sequence[str]], taken: Mapping[str, object]) -> dict[str, list[str]]:
    """Groups by name: the common beginning of their nodes' names, numbered; single nodes are left out."""
    named: dict[str, list[str]] = {}
    for names in groups:
        if len(names) < 2:
            continue
        stem = _stem(names)
        number = 1
        while f"{stem}_{number}" in named or f"{stem}_{number}" in taken:
            number += 1
        named[f"{stem}_{number}"] = list(names)
    return named


def _stem(names: Sequence[str]) -> str:
    insulation = all(name.endswith("insulation") for name in names)
    plates = [name.partition("[")[0] for name in names]
    common = plates[0]
    for plate in plates[1:]:
        while not plate.startswith(common):
            common = common[:-1]
    common = common.rstrip(".")
    return (common or "group") + ("_insulation" if insulation else "")
