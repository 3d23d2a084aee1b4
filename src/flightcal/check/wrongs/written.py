"""Numbers of the scenario, and its priors."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import combinations, product

import numpy as np

from ...problem import PIN
from ...scenario import ICE_POINT, OF_EARTH_AND_SUN, Environment
from ...simulator import FloatArray
from ...words import listed, number
from ..evidence import Fit
from ..network_view import NO_LINK, SHARES, Moved, View
from .wrong import AROUND, FACTORS, FEW_TIMES, POWER, Words, Wrong

_BLOCKS = ("nodes", "conductors", "faces", "modes", "environment")
"""Of a scenario, whose numbers are tried; heaters and loads are tried elsewhere."""
_PER_NUMBER = 3.0
"""Ways in which each number is off, about."""
_OF_AREAS = (1e-4, 1e4)
"""Factors by which an area in cm^2 is off."""
_COVERED = 0.1
"""Times an area, up to which a face may be one below insulation."""
_OFF = 1.3
"""Factor up to which a number is off as numbers are, which are known to about 10%;"""
_MATTERS = 1.4
"""that by which several are off together, or two that are exchanged are apart."""
_NONE = 10.0 * NO_LINK
"""Below, a number is not there."""
_USUAL = {f"environment.{field}": float(getattr(Environment(), field)) for field in OF_EARTH_AND_SUN}
"""What numbers of the Earth and the Sun are, about; SI."""
_BELIEVABLE = {f"environment.{field}": bounds for field, bounds in OF_EARTH_AND_SUN.items()}
"""No wrong is mended by a number of the Sun or the Earth that cannot be."""
_ALIKE: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("nodes.", ("capacity",)), ("conductors.", ("conductance",)), ("faces.", ("area",)),
    ("faces.", ("absorptivity", "emissivity")),
)  # fmt: skip
"""Numbers that are got wrong by exchanging those of two,"""
_MOST_ALIKE = 12
"""of so many at most."""
_MOST_COATINGS = 40
"""Faces whose own two numbers are exchanged: there are as many ways as faces, not as pairs of them."""
_OF_PARTS = frozenset((block, kind) for block, kinds in _ALIKE for kind in kinds)
"""Numbers that parts have in common,"""
_MOST_OF_PARTS = 12
"""so many at most."""
_TOGETHER = (1.0 / _MATTERS, _MATTERS, *FEW_TIMES)
"""Times what they are, of numbers that are wrong together."""
_OF_ALL = ("capacity", "conductance", "area")
"""Numbers that may be wrong in all parts by one factor."""
_MOST_HELD = 10.0
"""Of the heat that all other nodes hold, what one may hold."""
_COLDEST, _HOTTEST = 2.0, 600.0
"""K, between which nodes are held."""
_FAR = 4.0
"""Deviations of its prior, from which a parameter is far off."""


def numbers(view: View) -> Iterator[Wrong]:
    """A number of the scenario has the wrong unit, a digit too many, or is about twice what it should be."""
    paths, fixed = view.network.network.paths, _fixed_numbers(view)
    for k in fixed:
        for factor in (*FACTORS, *(_OF_AREAS if paths[k].endswith(".area") else ())):
            yield from _number(view, [k], paths[k], factor, tries=_PER_NUMBER * len(fixed))
        for factor in FEW_TIMES:
            near = partial(_near, view, [k], paths[k], factor, _PER_NUMBER * len(fixed))
            yield from _number(view, [k], paths[k], factor, _PER_NUMBER * len(fixed), near)
    for group in _alike(view, fixed):
        name = listed([paths[k] for k in group])
        for factor in (*FACTORS, *FEW_TIMES):
            near = partial(_near, view, group, name, factor, _PER_NUMBER * len(fixed))
            again = near if factor in FEW_TIMES else None
            yield from _number(view, group, name, factor, _PER_NUMBER * len(fixed), again)
    together = _together(view)
    for (places, name), factor in product(together.items(), _TOGETHER):
        tries = float(len(_TOGETHER) * len(together))
        near = partial(_near, view, places, name, factor, tries)
        yield from _number(view, places, name, factor, tries, near)


def _together(view: View) -> dict[tuple[int, ...], str]:
    """Places of numbers that one slip makes wrong together, named: all of a kind, what modes bring to a node or all."""
    paths, found = view.network.network.paths, defaultdict[str, list[int]](list)
    for k in view.window.sizes:
        block, *_, last = paths[k].split(".")
        if view.network.mapping.written[k] <= _NONE or PIN in paths[k]:
            continue
        if last in _OF_ALL:
            found[f"every {last}"].append(k)
        elif block == "modes":
            found["the power of every mode"].append(k)
            found[f"the power of every mode in {last}"].append(k)
    return {tuple(places): name for name, places in found.items() if len(places) > 1}


def _alike(view: View, fixed: Sequence[int]) -> list[list[int]]:
    """Places of numbers of one kind that are the same, as of one coating or of equal parts: they are one slip."""
    found: dict[tuple[str, float], list[int]] = {}
    for k in fixed:
        block, *_, kind = view.network.network.paths[k].split(".")
        if (f"{block}.", kind) in _OF_PARTS:
            found.setdefault((kind, float(view.network.mapping.written[k])), []).append(k)
    return [group for group in found.values() if 1 < len(group) <= _MOST_OF_PARTS]


def _fixed_numbers(view: View) -> list[int]:
    """Places of the numbers of `_BLOCKS` that no parameter sets."""
    mapping, paths = view.network.mapping, view.network.network.paths
    moved = set(mapping.set_positions.tolist())
    return [
        k
        for k in view.window.sizes
        if k not in moved and paths[k].partition(".")[0] in _BLOCKS and mapping.written[k] > _NONE
    ]


def _near(view: View, places: Sequence[int], name: str, factor: float, tries: float) -> Iterator[Wrong]:
    least = _OFF if len(places) == 1 else 1.0 + POWER
    for more in AROUND:
        times = factor * more
        if not 1.0 / least < times < least:
            yield from _number(view, places, name, times, tries, partial(_near, view, places, name, times, tries))


def _number(
    view: View,
    places: Sequence[int],
    name: str,
    factor: float,
    tries: float,
    closer: Callable[[], Iterator[Wrong]] | None = None,
) -> Iterator[Wrong]:
    """Numbers at places multiplied by a factor; nothing where they could not be so."""
    value = factor * float(view.network.mapping.written[places[0]])
    if name.rpartition(".")[2] in SHARES and value > 1.0:
        return
    low, high = _BELIEVABLE.get(name, (-np.inf, np.inf))
    changed = view.numbers.copy()
    changed[list(places)] *= factor
    if not low <= value <= high or (factor > 1.0 and _holds_too_much(view, changed)):
        return
    # Insulation leaves of absorptivity and emissivity a small share of what is below it.
    blanket = ", and whether insulation covers it" if name.endswith(".area") and factor <= _COVERED else ""
    one, unit = len(places) == 1, view.units.get(view.network.network.paths[places[0]], "")
    words = Words(
        f"{name} {'are' if ' and ' in name else 'is'} {number(1.0 / factor, 2 if closer or not one else 4)} times what "
        f"{'they' if ' and ' in name else 'it'} should be",
        f"The telemetry agrees with {_measured(value, 3, unit)}, not {_measured(value / factor, 4, unit)}."
        if one
        else f"With all of them times {number(factor, 2)}, the model explains the telemetry.",
        f"Check '{name}', and its unit{blanket}; if it is right, the scenario lacks something that acts like it",
    )
    multiplied = _multiplied(view, [(k, factor) for k in places])
    if multiplied is not None:
        moved, written = multiplied
        window = view.with_numbers(written)
        yield Wrong("number", name, words, window=window, moved=moved, tries=tries, closer=closer)


def _multiplied(view: View, by: Iterable[tuple[int, float]]) -> tuple[Moved, FloatArray] | None:
    """Entries that are moved and numbers as written, where numbers at places are so many times what they are.

    None: no parameter can be so, or a parameter would have to be two things.
    """
    mapping, names = view.network.mapping, view.problem.names
    setting = dict(zip(mapping.set_positions.tolist(), mapping.set_by.tolist(), strict=True))
    written, moved = mapping.written.copy(), dict[int, float]()
    for place, times in by:
        if place not in setting:
            written[place] *= times
        elif moved.setdefault(names.index(view.network.names[setting[place]]), times) != times:
            return None
    entries = tuple(sorted(moved.items()))
    if moved and not np.isfinite(_apart(view, replace(view, moved=entries))).all():
        return None
    return entries, written


def _holds_too_much(view: View, changed: FloatArray) -> bool:
    """Whether with changed numbers [V] one node holds far more heat than all others, and did not before.

    A channel that hardly changes is explained by any capacity that is large enough, whatever keeps it.
    """
    paths = view.network.network.paths
    places = [k for k, path in enumerate(paths) if path.startswith("nodes.") and path.endswith(".capacity")]

    def most(numbers: FloatArray) -> float:
        """What the largest capacity is of all others."""
        others = float(numbers[places].sum() - numbers[places].max(initial=0.0))
        return float(numbers[places].max(initial=0.0)) / others if others > 0.0 else np.inf

    return most(changed) > max(_MOST_HELD, most(view.numbers))


def boundaries(view: View) -> Iterator[Wrong]:
    """A node is held at a temperature that was written in another unit, as deep space at 3 degC."""
    mapping, paths = view.network.mapping, view.network.network.paths
    known = set(mapping.set_positions.tolist())
    places = [k for k, path in enumerate(paths) if path.endswith(".boundary") and PIN not in path and k not in known]
    for k in places:
        written = float(mapping.written[k])
        for value, wrong, right in (
            (written - ICE_POINT, f"{number(written - ICE_POINT, 3)} degC", f"{number(written - ICE_POINT, 3)} K"),
            (written + ICE_POINT, f"{number(written, 3)} K", f"{number(written, 3)} degC"),
        ):
            if not _COLDEST <= value <= _HOTTEST:
                continue
            changed = mapping.written.copy()
            changed[k] = value
            words = Words(
                f"{paths[k]} is {right}, not {wrong}",
                f"With {right} the model explains the telemetry.",
                f"Write '{right}' in '{paths[k]}'",
            )
            yield Wrong("number", paths[k], words, window=view.with_numbers(changed), tries=2.0 * len(places))


def coatings(view: View) -> Iterator[Wrong]:
    """Absorptivity and emissivity of every face are each other's, where no parameter says what they are."""
    paths, fixed = view.network.network.paths, {view.network.network.paths[k] for k in _fixed_numbers(view)}
    faces = [path.rpartition(".")[0] for path in paths if path.startswith("faces.") and path.endswith(".emissivity")]
    coating_paths = [path for face in faces for path in (f"{face}.absorptivity", f"{face}.emissivity")]
    if len(faces) < 2 or not fixed.issuperset(coating_paths):
        return
    written = view.network.mapping.written.copy()
    places = np.array([paths.index(path) for path in coating_paths]).reshape(-1, 2)
    written[places] = written[places[:, ::-1]]
    words = Words(
        "Absorptivity and emissivity are exchanged",
        "With the two of every face exchanged, the model explains the telemetry.",
        "Check 'absorptivity' and 'emissivity' in 'simulator: faces'",
    )
    yield Wrong("number", "every coating", words, window=view.with_numbers(written))


def left_out(view: View) -> Iterator[Wrong]:
    """Sunlight or heat from the Earth is written as zero, or as what it cannot be."""
    mapping, paths = view.network.mapping, view.network.network.paths
    if view.window.scenario.environment.orbit is None or not view.window.scenario.network.faces:
        return
    moved = set(mapping.set_positions.tolist())
    known = [path for path in _USUAL if path in paths and paths.index(path) not in moved]
    zero = [path for path in known if mapping.written[paths.index(path)] == 0.0]
    for path in known:
        low, high = _BELIEVABLE[path]
        value = float(mapping.written[paths.index(path)])
        if value > 0.0 and not low <= value <= high:
            yield from _number(view, [paths.index(path)], path, _USUAL[path] / value, tries=3.0)
    for chosen in [*([path] for path in zero), *([zero] if len(zero) > 1 else [])]:
        written = mapping.written.copy()
        written[[paths.index(path) for path in chosen]] = [_USUAL[path] for path in chosen]
        usual = [f"{_USUAL[path]:g} {view.units[path]}".strip() for path in chosen]
        words = Words(
            f"{listed(chosen)} {'is' if len(chosen) == 1 else 'are'} zero",
            f"With {listed(usual)}, the model explains the telemetry.",
            f"Write {listed([path.rpartition('.')[2] for path in chosen])} in 'environment'",
        )
        yield Wrong("number", " ".join(chosen), words, window=view.with_numbers(written), tries=3.0)


def priors(view: View) -> Iterator[Wrong]:
    """The prior of a parameter is narrow, and far from what the telemetry says."""
    names = view.problem.names
    parameters = [name for name in names if name in view.window.scenario.parameters]
    for name in parameters:
        k = names.index(name)

        def words(fit: Fit, name: str = name, k: int = k) -> Words:
            value, off = float(view.problem.to_theta(fit.z)[k]), abs(float(fit.added[0]))
            parameter = view.window.scenario.parameters[name]
            of_faces = (path.rpartition(".") for path in parameter.sets if path.startswith("faces."))
            faces = [face for face, _, key in of_faces if key in SHARES]
            # Of an absorptivity that is more than one, the rest is its area.
            areas = listed([f"{face}.area" for face in faces])
            instead = f"; no surface has so much: check {areas}" if faces and value > 1.0 else ""
            return Words(
                f"The prior of {name} is far from the telemetry",
                f"The telemetry agrees with {name} = {_measured(value, 3, parameter.unit)}, {number(off, 2)} "
                "deviations of its prior away.",
                f"Check the prior of {name}, and its unit{instead}",
            )

        yield Wrong("prior", name, words, widened=k, least=_FAR, tries=len(parameters))


def _measured(value: float, digits: int, unit: str) -> str:
    """A value with its unit, where it has one."""
    return f"{number(value, digits)} {unit}".strip()


def _apart(view: View, moved: View) -> FloatArray:
    """[k] deviations by which the entries of a view are moved; inf: its prior cannot be there."""
    entries = [entry for entry, _ in moved.moved]
    with np.errstate(all="ignore"):  # out of their bounds
        off = abs(moved.middle - view.middle)[entries] / view.spread[entries]
        possible = (moved.spread[entries] > 0.0) & np.isfinite(moved.spread[entries]) & np.isfinite(off)
    return np.where(possible, off, np.inf)


def other_priors(view: View) -> Iterator[Wrong]:
    """The prior of a parameter is narrow, and has the wrong unit or is a few times what it should be.

    What is nearer to it is seen by `priors`.
    """
    parameters = [name for name in view.problem.names if name in view.window.scenario.parameters]
    for name, factor in product(parameters, (*FACTORS, *FEW_TIMES)):
        tries = _PER_NUMBER * len(parameters)
        yield from _of_prior(view, name, factor, tries, near=factor in FEW_TIMES)


def _of_prior(view: View, name: str, factor: float, tries: float, *, near: bool) -> Iterator[Wrong]:
    """The prior of a parameter moved by a factor; nothing where it could not be so. near: others are tried about it."""
    entry = view.problem.names.index(name)
    moved = replace(view, moved=((entry, factor),))
    if not _FAR < _apart(view, moved)[0] < np.inf or (factor > 1.0 and _holds_too_much(view, moved.numbers)):
        return

    def closer() -> Iterator[Wrong]:
        for more in AROUND:
            yield from _of_prior(view, name, factor * more, tries, near=True)

    value, median = (float(matrix.median[entry]) for matrix in (moved, view))
    unit = view.window.scenario.parameters[name].unit
    words = Words(
        f"The prior of {name} is {number(1.0 / factor, 2)} times what it should be",
        f"The telemetry agrees with a median of {_measured(value, 3, unit)}, not of {number(median, 3)}.",
        f"Check the prior of {name}, and its unit",
    )
    yield Wrong("prior", name, words, moved=moved.moved, tries=tries, closer=closer if near else None)


def exchanged(view: View) -> Iterator[Wrong]:
    """Two capacities, conductances, areas or coatings are each other's, or the two numbers of a coating are.

    As they are written or in priors.
    """
    found: dict[tuple[Moved, tuple[float, ...]], tuple[str, Words]] = {}
    for about, words, places in (*_of_two_parts(view), *_of_one_coating(view)):
        # Parameters that set the numbers of several faces exchange those of all of them.
        change = _exchange(view, view.numbers, places)
        if change is not None:
            moved, written = change
            found.setdefault((moved, tuple(written.tolist())), (about, words))
    for (moved, numbers), (about, words) in found.items():
        window = view.with_numbers(np.array(numbers))
        yield Wrong("exchanged", about, words, window=window, moved=moved, tries=len(found))


_Exchange = tuple[str, Words, list[tuple[int, ...]]]
"""What it is about, its words, and the places of the numbers that are exchanged, in pairs."""


def _of_two_parts(view: View) -> Iterator[_Exchange]:
    """Numbers of two nodes, two conductors or two faces."""
    paths, now = view.network.network.paths, view.numbers
    for block, numbers in _ALIKE:
        places_of = [k for k, path in enumerate(paths) if path.startswith(block) and path.endswith(numbers[0])]
        known = [k for k in places_of if now[k] > _NONE and PIN not in paths[k]]
        blocks = [paths[k].rpartition(".")[0] for k in sorted(known, key=lambda k: -now[k])]
        for a, b in combinations(blocks, 2) if len(blocks) <= _MOST_ALIKE else ():
            places = [tuple(paths.index(f"{name}.{number}") for name in (a, b)) for number in numbers]
            if all(now[p] > _NONE and now[q] > _NONE for p, q in places):
                what = " and ".join(numbers)
                words = Words(
                    f"{a} and {b} have each other's {what}",
                    f"With {what} of the two exchanged, the model explains the telemetry.",
                    f"Check {what} of {a} and of {b}, and the priors of what sets them",
                )
                yield f"{a}.{numbers[0]} {b}.{numbers[0]}", words, places


def _of_one_coating(view: View) -> Iterator[_Exchange]:
    """Absorptivity and emissivity of a face, and of all that have the same."""
    paths, now = view.network.network.paths, view.numbers
    faces = [path.removesuffix(".emissivity") for path in paths if path.startswith("faces.") and ".emissiv" in path]
    alike: dict[tuple[float, ...], list[str]] = {}
    for face in faces:
        pair = tuple(float(now[paths.index(f"{face}.{kind}")]) for kind in ("absorptivity", "emissivity"))
        alike.setdefault(pair, []).append(face)
    groups = [members for members in alike.values() if 1 < len(members) < len(faces)]
    for members in (*([face] for face in faces), *groups) if len(faces) <= _MOST_COATINGS else ():
        places = [tuple(paths.index(f"{face}.{kind}") for kind in ("absorptivity", "emissivity")) for face in members]
        name = listed(members)
        words = Words(
            f"Absorptivity and emissivity of {name} are exchanged",
            f"With the two of {name} exchanged, the model explains the telemetry.",
            f"Check 'absorptivity' and 'emissivity' of {name}, and the priors of what sets them",
        )
        yield " ".join(f"{face}.absorptivity {face}.emissivity" for face in members), words, places


def _exchange(view: View, now: FloatArray, places: Sequence[tuple[int, ...]]) -> tuple[Moved, FloatArray] | None:
    """Entries that are moved and numbers as they are written, where those at pairs of places [..., 2] are exchanged.

    now: the numbers [V] at the priors' medians. None: the exchange changes nothing, or it cannot be.
    """
    # A number is moved by a factor, and none makes another one of 0.
    if not all(now[p] and now[q] for p, q in places):
        return None
    if all(1.0 / _MATTERS < now[p] / now[q] < _MATTERS for p, q in places):
        return None
    both_ways = [(p, q) for pair in places for p, q in (pair, pair[::-1])]
    return _multiplied(view, [(one, float(now[other] / now[one])) for one, other in both_ways])


WRONGS = (numbers, boundaries, coatings, left_out, exchanged, priors, other_priors)
"""What looks for them."""
