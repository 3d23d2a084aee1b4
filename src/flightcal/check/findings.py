"""What a check says, in plain words: findings that matter (bad), cautions (warn), and what is well (good)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np

from ..report import ORDER, Finding, ParameterInfo, likely, listed, moment, number, percent, unit
from .centre import Centre
from .evaluate import runs_for_draws
from .heat import ALIKE, BesideHeat, Imitated, Kind
from .identifiability import BLIND, Combination, Identifiability, Move
from .prior_predictive import EDGE, ChannelReach, PriorPredictive
from .profile import Profile
from .sensitivity import LIKELIHOOD, Sensitivity
from .smoothness import REACH, TOLERANCE, Jump, Smoothness
from .suspicion import Suspects

_REACHED = 0.5
"""Share of a channel's telemetry that the prior must reach."""
_MOSTLY = 0.95
_FAILURES = 0.05
_SERIOUS = 1.0
"""Nats from which a jump hinders a sampler."""
_CLIFF = 100.0
"""Nats beyond which nothing of the posterior is left on the lower side."""
_NEAR = 2.0
"""Standard deviations within which most of the posterior is."""
_LARGE = 0.25
"""Relative change of a parameter from which it matters that the telemetry cannot tell."""
_IDLE = 0.01
"""Total index below which an output does not depend on a parameter."""
_TELLS: dict[Kind, str] = {
    "surface": "eclipses or attitudes",
    "power": "modes or powers",
    "path": "heater pulses, modes or powers",
    "other": "changes of sunlight, modes or heaters",
}
"""What would tell a parameter from heat that the model lacks."""


@dataclass(frozen=True)
class Checked:
    """All that a check has found of a problem."""

    infos: tuple[ParameterInfo, ...]
    """Of theta's entries, in its order."""
    suspects: Suspects
    centre: Centre
    identifiability: Identifiability
    heat: BesideHeat | None
    """None: the problem has no unmodelled heat."""
    predictive: PriorPredictive
    sensitivity: Sensitivity
    smoothness: Smoothness
    profiles: tuple[Profile, ...]
    starts: dict[str, np.datetime64]
    """Of each window by its label, UTC."""
    budget: str
    """What was spent, in words."""

    def info(self, name: str) -> ParameterInfo:
        """How a parameter is shown."""
        return next(info for info in self.infos if info.name == name)

    def named(self, name: str, window: str) -> str:
        """A channel or a heater in a window, which is named where there are several."""
        return name if len(self.starts) == 1 else f"{name} in '{window}'"

    def value(self, name: str, theta: float) -> str:
        """A value of a parameter with its unit, as it is shown."""
        info = self.info(name)
        return f"{number(theta + info.offset)} {unit(info.unit)}".strip()


def findings_of(checked: Checked) -> list[Finding]:
    """All findings, the worst first, and of those the ones that a user should mend first."""
    found = [
        *suspected(checked.suspects),
        *_centre(checked),
        *_reach(checked),
        *_failures(checked),
        *_identifiability(checked),
        *heat_findings(checked.heat),
        *_gradient(checked),
        *_jumps(checked),
        _sensitivity(checked),
        *(_profile(checked, profile) for profile in checked.profiles),
    ]
    return sorted(found, key=lambda finding: ORDER.index(finding.state), reverse=True)


def verdict_of(findings: Sequence[Finding]) -> tuple[bool, str]:
    """Whether nothing stands against sampling, and one sentence."""
    bad = [finding for finding in findings if finding.state == "bad"]
    cautions = sum(finding.state == "warn" for finding in findings)
    beside = f"{cautions} caution{'s' if cautions != 1 else ''}"
    if bad:
        many = "1 finding matters" if len(bad) == 1 else f"{len(bad)} findings matter"
        beside = f", and there {'is' if cautions == 1 else 'are'} {beside}" if cautions else ""
        return False, f"Mend this before sampling, or know why not: {many}{beside}."
    return True, f"Ready to sample, with {beside}." if cautions else "Ready to sample: nothing stands against it."


def suspected(suspects: Suspects) -> list[Finding]:
    """What is likely to be wrong before anything else: of comparisons with the simulator the best, the others below."""
    compared = any(own.nats is not None for own in suspects.found)
    found = [
        replace(own, text=f"{own.text} {own.then}", then="") for own in likely([asdict(own) for own in suspects.found])
    ]
    if suspects.misfit is not None and not compared:
        text = f"Unmodelled heat has to make up for more than is usual. {suspects.misfit.words}"
        found.append(Finding("warn", "No simple wrong explains how far the model is off", text))
    if suspects.looked and not found:
        text = "Clocks, units, biases, swapped channels, status, heaters, modes, drivers and the orbit were tried."
        if suspects.why_not:
            text = (
                "Clocks, units, biases, swapped channels, status and priors were tried. What parameters or initial "
                "temperatures can make up for is not told from them."
            )
        found.append(Finding("good", "No simple wrong explains the telemetry better than the scenario", text))
    if suspects.why_not:
        text = (
            f"Nothing of this kind was compared with the simulator: {suspects.why_not}. Look for it yourself where the "
            "prior does not reach the telemetry, or where a value or a noise is far out in its prior."
        )
        found.append(Finding("warn", f"Not looked for: {suspects.left_out}", text))
    return found


def _centre(checked: Checked) -> list[Finding]:
    if checked.centre.is_mode:
        return []
    text = f"What follows holds at {checked.centre.words}, which may be far from the best fit."
    return [Finding("warn", "The mode was not found for sure", text)]


# --- prior predictive ------------------------------------------------------------------------------------------


def _reach(checked: Checked) -> list[Finding]:
    found = []
    predictive = checked.predictive
    missed = _worst_first(c for c in predictive.channels if c.reached < _REACHED)
    partly = _worst_first(c for c in predictive.channels if _REACHED <= c.reached < _MOSTLY)
    details = tuple(
        f"{checked.named(c.channel, c.window)}: {percent(c.reached)} of the telemetry is reached; at most it is "
        f"{number(abs(c.beyond), 3)} K {'above' if c.beyond > 0 else 'below'} all that the prior gives."
        for c in (*missed, *partly)
    )
    if missed:
        names = listed([checked.named(c.channel, c.window) for c in missed])
        text = (
            "No parameters that the prior holds likely bring the simulator there, whatever the noise. "
            "Look for a wrong unit, offset or load in the model first; then widen the priors of what drives "
            f"{'it' if len(missed) == 1 else 'them'}: {_drivers(checked, [c.channel for c in missed])}."
        )
        found.append(Finding("bad", f"The prior cannot reach the telemetry of {names}", text, details))
    elif partly:
        names = listed([checked.named(c.channel, c.window) for c in partly])
        text = "The model, or a prior that is too narrow, leaves parts of the telemetry out."
        found.append(Finding("warn", f"The prior does not reach all telemetry of {names}", text, details))
    out = [heater for heater in predictive.heaters if not heater.reached]
    if out:
        names = listed([checked.named(h.heater, h.window) for h in out])
        found.append(
            Finding(
                "warn",
                f"The prior does not reach the duty cycle of {names}",
                "Power, thresholds or losses may be off.",
                tuple(
                    f"{checked.named(h.heater, h.window)}: on for {percent(h.observed)} of the time, the prior gives "
                    f"{percent(h.lower)} to {percent(h.upper)}." for h in out
                ),
            )
        )  # fmt: skip
    if predictive.pressed:
        best = "is best at" if checked.centre.is_mode else "goes, as far as the best fit was sought, to"
        text = "Data and prior disagree, or the parameter makes up for something that the model lacks. " + " ".join(
            f"{p.name} {best} {checked.value(p.name, p.theta)}, {_tail(p.probability)} of its prior."
            for p in predictive.pressed
        )
        title = f"The telemetry pulls {listed([p.name for p in predictive.pressed])} to the edge of the prior"
        found.append(Finding("warn", title, text))
    if not found:
        lowest = min(predictive.channels, key=lambda c: np.nan_to_num(c.inside, nan=np.inf))
        where = checked.named(lowest.channel, lowest.window)
        share = "All" if lowest.inside == 1.0 else f"At least {percent(lowest.inside)} ({where})"
        text = (
            f"{share} of each channel's telemetry lies inside the prior's 95% band, and no parameter is pulled to the "
            f"outer {EDGE:.0%} of its prior."
        )
        found.append(Finding("good", "The prior reaches the telemetry", text))
    return found


def _worst_first(channels: Iterable[ChannelReach]) -> list[ChannelReach]:
    """By the share that the prior reaches, then by how far it is off."""
    return sorted(channels, key=lambda c: (c.reached, -abs(c.beyond)))


def _tail(probability: float) -> str:
    share = min(probability, 1.0 - probability)
    shown = f"{100 * share:.1g}%" if share > 1e-5 else "less than 0.001%"
    return f"in the {'lowest' if probability < 0.5 else 'highest'} {shown}"


def _drivers(checked: Checked, channels: list[str]) -> str:
    """The parameters that matter most to some channels."""
    rows = [checked.sensitivity.outputs.index(channel) for channel in channels]
    strength = checked.sensitivity.strongest[rows].max(axis=0)
    chosen = [k for k in np.argsort(-strength)[:3] if strength[k] > 0.05]
    return listed([checked.sensitivity.names[k] for k in chosen]) or "none of the parameters moves it"


def _failures(checked: Checked) -> list[Finding]:
    predictive = checked.predictive
    if not predictive.failed:
        return []
    share = predictive.failed / predictive.draws
    why = "".join(f" {said[0].upper()}{said[1:]}." for said in predictive.why)
    text = (
        f"{predictive.failed} of {predictive.draws} simulations at prior draws fail.{why} Where one fails the "
        "posterior is cut off; narrow the priors to what the simulator can do."
    )
    state = "bad" if share > 0.5 else "warn" if share > _FAILURES else "good"
    return [Finding(state, f"{percent(share)} of the prior cannot be simulated", text)]  # type: ignore[arg-type]


# --- identifiability -------------------------------------------------------------------------------------------


def _identifiability(checked: Checked) -> list[Finding]:
    combinations = checked.identifiability.combinations
    of_noise = [own for own in combinations if all(name.startswith("noise.") for name in own.names)]
    alone = combinations if len(of_noise) < 2 else [own for own in combinations if own not in of_noise]
    found = [combination_finding(checked, own) for own in alone]
    if len(of_noise) > 1:
        found.append(_noise_finding(checked, of_noise))
    correlated = checked.identifiability.correlated
    if correlated:
        shown = tuple(f"{a} and {b}: correlation {number(r, 3)}." for a, b, r in correlated)
        text = (
            "The telemetry tells their combination better than each of them. Sampling is whitened and copes; "
            "but their intervals are wide one by one, and neither should be read alone."
        )
        pairs = f"{len(correlated)} pair{'s' if len(correlated) > 1 else ''} of parameters"
        found.append(Finding("warn", f"{pairs} with a correlation beyond 0.95", text, shown))
    if not checked.identifiability.combinations:
        least = 1.0 / math.sqrt(1.0 + float(checked.identifiability.information[0]))
        widest = int(np.argmax(checked.identifiability.width))
        name, width = checked.identifiability.names[widest], float(checked.identifiability.width[widest])
        text = (
            f"In the least known direction the posterior is {percent(least, 0)} as wide as the prior; "
            f"of the parameters {name} is known least ({percent(width, 0)})."
        )
        found.insert(0, Finding("good", "The telemetry tells every parameter, and every combination of them", text))
    return found


def _noise_finding(checked: Checked, combinations: Sequence[Combination]) -> Finding:
    """What the data cannot tell of the noise of several channels: of each a line would hide what matters."""
    names = sorted({name for own in combinations for name in own.names})
    channels = sorted({name.split(".")[1] for name in names})
    text = (
        "How long its errors last, or how large they are, is then as the prior says: the parameters' intervals are "
        "little changed by that."
    )
    details = tuple(_trade(checked, own) for own in combinations)
    return Finding("warn", f"The telemetry says little of the noise of {listed(channels)}", text, details)


def combination_finding(checked: Checked, combination: Combination) -> Finding:
    """What the data cannot tell, with advice.

    It matters where parameters of the scenario hide each other and may be far off together; a parameter of which the
    telemetry says nothing harms neither the sampling nor the prediction.
    """
    names = list(combination.names)
    blind = combination.information < BLIND
    width = f"the posterior is {percent(combination.width, 0)} as wide as the prior"
    if combination.kind == "alone":
        name = names[0]
        title = f"The telemetry says {'next to nothing' if blind else 'little'} of {name}"
        advice = (
            "It starts where the telemetry does not look; a tighter prior costs nothing."
            if name.startswith("initial.")
            else "Fix it, or trust its prior: its posterior will be that."
        )
        return Finding("warn", title, f"Along it {width}. {advice}", (_trade(checked, combination),))
    product = " × ".join(names)
    what, advice = {
        "product": (
            f"{listed(names)} act alike: only their product is known",
            f"Fix one of them, or replace them by one parameter for {product}.",
        ),
        "ratio": (
            f"{listed(names)} make up for each other: only their ratio is known",
            "Fix one of them, or let one parameter scale both and another set their ratio.",
        ),
        "scale": (
            f"{listed(names)} can all be scaled together: only their ratios are known",
            "Fix one of them, at best the one that drawings or tests tell, or give it a prior that is tight.",
        ),
        "mixed": (
            f"{listed(names)} make up for one another",
            f"Fix or tie {names[0]}, or say more in its prior.",
        ),
    }[combination.kind]  # fmt: skip
    both = sum(checked.info(name).kind == "parameter" for name in names) >= 2
    title = what if blind else f"{what}, {'for the most part' if combination.kind == 'mixed' else 'or little more'}"
    text = f"Along this combination {width}. {advice}"
    large = any(abs(move.change) > _LARGE for move in combination.moves)
    return Finding("bad" if blind and both and large else "warn", title, text, (_trade(checked, combination),))


def _trade(checked: Checked, combination: Combination) -> str:
    moved = listed([_moved(checked, move) for move in combination.moves])
    return f"The telemetry hardly notices {moved}{' together' if len(combination.moves) > 1 else ''}."


def _moved(checked: Checked, move: Move) -> str:
    """A move in percent where that has a meaning, else from one value to another, such as of a threshold in degC."""
    if math.isfinite(move.exponent) and move.before > 0.0 and checked.info(move.name).offset == 0.0:
        change = 100.0 * move.change
        return f"{move.name} {number(change, 2) if change < 0 else '+' + number(change, 2)}%"
    return f"{move.name} from {checked.value(move.name, move.before)} to {checked.value(move.name, move.after)}"


# --- unmodelled heat -------------------------------------------------------------------------------------------


def heat_findings(heat: BesideHeat | None) -> list[Finding]:
    """What unmodelled heat takes from the parameters, and what would tell them; empty where there is none."""
    if heat is None:
        return []
    matter = [own for own in heat.parameters if own.matters]
    if not matter:
        text = "No parameter's effect is like what heat of its prior's size can do."
        return [Finding("good", "Unmodelled heat takes little from the parameters", text)]
    found = []
    for kind, advice in _TELLS.items():
        alike = [own for own in matter if own.kind == kind]
        if alike:
            title = f"Unmodelled heat makes {listed([own.name for own in alike])} hard to tell"
            details = tuple(imitated_words(own) for own in alike)
            text = (
                "This is so where heat has its prior's size; where the telemetry shows less, intervals are narrower. "
                f"Other {advice} than those in the training windows would tell."
            )
            found.append(Finding("warn", title, text, details))
    if heat.pairs:
        shown = tuple(f"{a} and {b}: heat in {node}, cosine {cosine:.2f}." for a, b, node, cosine in heat.pairs)
        title = f"One heat imitates both of {len(shown)} pair{'s' if len(shown) > 1 else ''} of parameters"
        found.append(Finding("warn", title, "Neither of the two should be read alone.", shown))
    return found


def imitated_words(own: Imitated) -> str:
    """What heat takes from a parameter."""
    what = f"Heat in {own.node} can imitate {own.name}" if own.cosine > ALIKE else f"Heat hides {own.name}"
    return (
        f"{what} (cosine {own.cosine:.2f}): its interval will be about {times(own.growth)} times as wide as "
        f"without heat, {percent(own.beside, 0)} as wide as the prior's."
    )


def times(growth: float) -> str:
    """How many times, as it is shown."""
    return f"{growth:.0f}" if growth >= 9.95 else f"{growth:.1f}"


# --- smoothness ------------------------------------------------------------------------------------------------


def _gradient(checked: Checked) -> list[Finding]:
    errors = checked.smoothness.gradient
    if not errors:
        text = "The simulator has no derivatives; it will be calibrated through an emulator."
        return [Finding("none", "There is no gradient to check", text)]
    wrong = sorted((e for e in errors if e.error > TOLERANCE), key=lambda e: -e.error)
    if not wrong:
        worst = max(errors, key=lambda e: e.error)
        text = (
            f"At {checked.smoothness.points} points it agrees with differences of the log density to "
            f"{number(worst.error, 2)} ({worst.name}; in nats per standard deviation)."
        )
        return [Finding("good", "The gradient is right", text)]
    details = tuple(
        f"{e.name}: given {number(e.gradient)}, by differences {number(e.difference)} (on the unconstrained scale)."
        for e in wrong
    )
    text = (
        "NUTS follows the gradient: with a wrong one it rejects or gets lost. If the simulator is yours, check its "
        "derivatives; if it is flightcal's, report this."
    )
    return [Finding("bad", f"The gradient is wrong for {listed([e.name for e in wrong])}", text, details)]


def _jumps(checked: Checked) -> list[Finding]:
    smoothness = checked.smoothness
    jumps = smoothness.jumps
    several = [scan.name for scan in smoothness.scans if len(set(scan.sequence)) > 1]
    where = f"within {REACH:g} standard deviations of the posterior"
    if not smoothness.located:
        text = f"{len(smoothness.scans[0].place)} points along each parameter are too few to find jumps."
        if several:
            text += (
                f" Along {listed(several)} the heaters switch another number of times; each such change may be a jump."
            )
        return [Finding("warn" if several else "none", "Jumps were not looked for", text)]
    if not jumps:
        text = f"Scans along every parameter find no jump of a tenth of a nat or more {where}."
        if several:
            text += f" Along {listed(several)} the heaters do switch another number of times."
        return [Finding("good", "The log density is smooth", text)]
    serious = [jump for jump in jumps if abs(jump.nats) >= _SERIOUS and abs(jump.place) <= _NEAR]
    causes = sorted({jump.heater for jump in jumps if jump.heater})
    title = f"The log density jumps by {_nats(jumps[0].nats, 'up to ')} {where}"
    text = (
        f"Along {listed(sorted({jump.name for jump in jumps}))}. "
        + (
            f"There the trajectory grazes a threshold of {listed(causes)}, and on one side switches once more. "
            if causes
            else "No heater switches otherwise there: look for a discontinuity in the simulator. "
        )
        + "A sampler that crosses such a place diverges, or stays on one side of it. Choose a window in which the "
        "sensor keeps clear of its threshold, or drive the heaters by their measured status (heater_input: measured)."
    )
    return [Finding("bad" if serious else "warn", title, text, tuple(jump_words(checked, jump) for jump in jumps))]


def jump_words(checked: Checked, jump: Jump) -> str:
    """A jump with its place and its cause."""
    words = (
        f"{jump.name} at {checked.value(jump.name, jump.theta)} ({number(jump.place, 2)} standard deviations from the "
        f"mode): {'up' if jump.nats > 0 else 'down'} by {_nats(jump.nats)} as it grows"
    )
    if not jump.heater:
        return words + "."
    time = checked.starts[jump.window] + np.timedelta64(round(1e3 * jump.seconds), "ms")
    below, above = jump.switches
    return (
        f"{words}; {jump.heater} switches {below} times below and {above} above: the runs part at {moment(time)} UTC."
    )


def _nats(value: float, before: str = "") -> str:
    """The size of a jump; of a cliff only that it is one."""
    return f"more than {_CLIFF:.0f} nats" if abs(value) > _CLIFF else f"{before}{number(abs(value), 2)} nats"


# --- sensitivity and profiles ----------------------------------------------------------------------------------


def _sensitivity(checked: Checked) -> Finding:
    sensitivity = checked.sensitivity
    least = 4 * (len(sensitivity.names) + 2)
    if sensitivity.runs - sensitivity.failed < least:
        return Finding("none", "Sensitivities are not known", _too_few(checked, least))
    strength = np.minimum(sensitivity.strongest[sensitivity.outputs.index(LIKELIHOOD)], 1.0)
    leaders = [k for k in np.argsort(-strength)[:3] if strength[k] > _IDLE]
    shares = listed([f"{sensitivity.names[k]} ({percent(strength[k], 0)})" for k in leaders])
    idle = [n for n, s in zip(sensitivity.names, sensitivity.strongest.max(axis=0), strict=True) if s < _IDLE]
    text = f"Share of the likelihood's variance (of its rank): {shares}." if leaders else ""
    if idle:
        text += (
            f" Next to what these do, {listed(idle)} {'do' if len(idle) > 1 else 'does'} nothing over the whole prior "
            "(less than 1% of any output's variance); nearer to the best fit the telemetry may tell all the same."
        )
    names = listed([sensitivity.names[k] for k in leaders]) or "no parameter"
    return Finding("good", f"Over the whole prior the likelihood depends most on {names}", text.strip())


def _too_few(checked: Checked, least: int) -> str:
    """Why there are too few simulations, of which a check needs at least so many in each window."""
    runs = checked.sensitivity.runs
    if checked.sensitivity.failed:
        return "Too few simulations finished."
    enough = runs_for_draws(least, len(checked.starts))
    return f"They need {least} simulations over the prior, and there are {runs}: check again with `--runs {enough}`."


def _profile(checked: Checked, profile: Profile) -> Finding:
    lower, upper = (
        checked.value(profile.name, v) if math.isfinite(v) else "open" for v in (profile.lower, profile.upper)
    )
    text = f"95% interval by its profile: {lower} to {upper}, all others fitted again."
    if profile.told:
        return Finding("good", f"The likelihood alone bounds {profile.name}", text)
    text += " Without the priors the profile stays within 1.92 nats on one side or both."
    return Finding("warn", f"The likelihood alone does not bound {profile.name}", text)
