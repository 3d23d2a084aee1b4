"""From theta to the entries of the canonical form, and back for the derivative; see `simulator.assembly`."""

from __future__ import annotations

from typing import Any, NamedTuple

from ...compiled import inlined, kernel


class AssembleCall(NamedTuple):
    """What `assemble` takes: S rooms, of which the first ones are made."""

    simulations: Any
    """[1] how many."""
    mapping: Any
    terms: Any
    channel_errors: Any
    """[3, N] positions of the sensors' errors among the numbers."""
    thetas: Any
    """[S, d]"""
    extended: Any
    """Workspace for the numbers, a one, the reciprocals and the initial temperatures."""
    numbers: Any
    """[S, V]"""
    packed: Any
    """[S, P]"""
    errors: Any
    """[S, 3, N]"""


@kernel
def assemble(call):
    """Numbers, packed systems and the sensors' errors at thetas."""
    mapping, terms, thetas, extended = call.mapping, call.terms, call.thetas, call.extended
    numbers, packed, errors, channel_errors = call.numbers, call.packed, call.errors, call.channel_errors
    parameters = mapping.parameters
    for s in range(call.simulations[0]):
        for k in range(numbers.shape[1]):
            numbers[s, k] = mapping.written[k]
        for k in range(mapping.set_positions.shape[0]):
            numbers[s, mapping.set_positions[k]] = thetas[s, mapping.set_by[k]]
        for k in range(mapping.scaled_positions.shape[0]):
            numbers[s, mapping.scaled_positions[k]] *= thetas[s, mapping.scaled_by[k]]
        _extend(terms, numbers[s], thetas[s, parameters:], extended)
        packed[s] = 0.0
        for t in range(terms.entry.shape[0]):
            product = terms.constant[t]
            for k in range(terms.factors.shape[1]):
                product *= extended[terms.factors[t, k]]
            packed[s, terms.entry[t]] += product
        # A massless state's temperature is only guessed.
        guess = 0.0
        for k in range(parameters, thetas.shape[1]):
            guess += thetas[s, k] / (thetas.shape[1] - parameters)
        for i in range(terms.initial.shape[0]):
            place = terms.initial[i]
            packed[s, terms.entries + i] += thetas[s, parameters + place] if place >= 0 else guess
        for error in range(channel_errors.shape[0]):
            for k in range(channel_errors.shape[1]):
                errors[s, error, k] = numbers[s, channel_errors[error, k]]
    return 0


@inlined
def _extend(terms, numbers, temperatures, extended):
    """The numbers, a one, the reciprocals and the initial temperatures."""
    count = numbers.shape[0]
    for k in range(count):
        extended[k] = numbers[k]
    extended[count] = 1.0
    for k in range(terms.inverse.shape[0]):
        extended[count + 1 + k] = 1.0 / numbers[terms.inverse[k]]
    for k in range(temperatures.shape[0]):
        extended[count + 1 + terms.inverse.shape[0] + k] = temperatures[k]


class PullBackCall(NamedTuple):
    """What `pull_back` takes; the first of thetas and of numbers is meant."""

    mapping: Any
    terms: Any
    channel_errors: Any
    thetas: Any
    numbers: Any
    packed_bar: Any
    """[P]"""
    errors_bar: Any
    """[3, N]"""
    memory: Any
    """Twice the workspace of `assemble`, and as much as a term has factors."""
    theta_bar: Any
    """[d] what is asked for."""


@kernel
def pull_back(call):
    """The adjoint of `assemble`: theta_bar from packed_bar and errors_bar."""
    mapping, terms, theta, numbers = call.mapping, call.terms, call.thetas[0], call.numbers[0]
    packed_bar, used, used_bar = call.packed_bar, call.channel_errors, call.errors_bar
    memory, theta_bar = call.memory, call.theta_bar
    count = numbers.shape[0]
    first = count + 1 + terms.inverse.shape[0]
    temperatures = theta[mapping.parameters :]
    size = first + temperatures.shape[0]
    extended, extended_bar, before = memory[:size], memory[size : 2 * size], memory[2 * size :]
    theta_bar[:] = 0.0
    _extend(terms, numbers, temperatures, extended)
    extended_bar[:] = 0.0
    for kind in range(used.shape[0]):
        for k in range(used.shape[1]):
            extended_bar[used[kind, k]] += used_bar[kind, k]
    for t in range(terms.entry.shape[0]):
        # The product of all other factors, without a division: those before times those after.
        product = terms.constant[t] * packed_bar[terms.entry[t]]
        for k in range(terms.factors.shape[1]):
            before[k] = product
            product *= extended[terms.factors[t, k]]
        after = 1.0
        for back in range(terms.factors.shape[1]):
            k = terms.factors.shape[1] - 1 - back
            extended_bar[terms.factors[t, k]] += before[k] * after
            after *= extended[terms.factors[t, k]]
    for k in range(terms.inverse.shape[0]):
        inverse = extended[count + 1 + k]
        extended_bar[terms.inverse[k]] -= extended_bar[count + 1 + k] * inverse * inverse
    for k in range(mapping.set_positions.shape[0]):
        theta_bar[mapping.set_by[k]] += extended_bar[mapping.set_positions[k]]
    for k in range(mapping.scaled_positions.shape[0]):
        position, parameter = mapping.scaled_positions[k], mapping.scaled_by[k]
        if theta[parameter] != 0.0:
            others = numbers[position] / theta[parameter]
        else:
            others = mapping.written[position]
            for other in range(mapping.scaled_positions.shape[0]):
                if other != k and mapping.scaled_positions[other] == position:
                    others *= theta[mapping.scaled_by[other]]
        theta_bar[parameter] += extended_bar[position] * others
    for k in range(temperatures.shape[0]):
        theta_bar[mapping.parameters + k] += extended_bar[first + k]
    for i in range(terms.initial.shape[0]):
        if terms.initial[i] >= 0:
            theta_bar[mapping.parameters + terms.initial[i]] += packed_bar[terms.entries + i]
    return 0
