"""The decision from the first screen alone, for runs of different kinds: what is not folded has to be enough."""

import dataclasses
import html
import itertools
import json
import re

import pytest

from flightcal.report import page, verdict_of
from flightcal.report.masking import masked
from flightcal.report.page import render
from flightcal.report.panels import plans
from flightcal.report.panels.picture import choose, wide_intervals

from .cases import (
    CASES,
    USE,
    bad_model,
    good,
    heater_is_off,
    killed_before_a_posterior,
    no_heaters,
    not_converged,
    one_channel_fails,
    one_channel_says_nothing,
    prior_is_doubtful,
    status_is_not_measured,
    status_is_of_passes,
    with_a_limit,
    with_a_plan,
)
from .packed import drawn, without_scripts
from .test_browser import dump, needs_browser


@pytest.fixture(autouse=True)
def nothing_folded(monkeypatch):
    """What is folded takes most of the time, and has no part in the decision."""
    monkeypatch.setattr(page, "parts", lambda run: [])


@pytest.fixture(scope="module")
def pages(run):
    """The page of each case."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(page, "parts", lambda run: [])
        return {case.name: render(dataclasses.replace(case.make(run), stretches=100)) for case in CASES}


def sections_of(text):
    """What is read without opening anything: sections by their anchor, as words."""
    shown = re.sub(r"<wbr>|<details.*?</details>", "", without_scripts(text), flags=re.S)
    sections = re.findall(r'<section id="(\w+)"[^>]*>(.*?)</section>', shown, re.S)
    return {name: html.unescape(" ".join(re.sub(r"<[^>]+>", " ", body).split())) for name, body in sections}


def first_screen(run):
    """What is read without opening anything, and the page."""
    text = render(run)
    return sections_of(text), text


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_the_first_screen_tells_whether_to_use_it_why_and_what_to_do_next(run, pages, case):
    verdict = sections_of(pages[case.name])["verdict"]
    assert verdict.startswith(f"{case.decision} Did the sampling converge?")
    assert f" Next: {case.then}" in verdict
    judged = verdict_of(case.make(run))
    assert judged.exit_code == case.exit_code
    decide = [answer for answer in judged.answers if case.decision == USE or answer.state != "good"]
    assert any(case.reason in answer.worst.title for answer in decide)
    marks = re.findall(r"(✓ good|! caution|✕ problem|– not in this run) .*? why", verdict)
    assert marks == [answer.worst.mark for answer in judged.answers]


def test_numbers_of_a_run_that_is_not_to_be_used_say_so_where_they_stand(run):
    for kind, said in ((good, False), (one_channel_fails, False), (bad_model, True), (not_converged, True)):
        assert ("Not to be used: see the verdict." in first_screen(kind(run))[0]["calibrated"]) == said


def test_a_value_in_doubt_is_marked_in_its_row(run):
    assert "battery_link in doubt" in first_screen(prior_is_doubtful(run))[0]["calibrated"]
    assert "in doubt" not in first_screen(good(run))[0]["calibrated"]


def test_parameters_have_before_after_interval_unit_and_the_telemetry_s_share(run):
    table = first_screen(good(run))[0]["calibrated"]
    assert "battery_link 1.040 0.6001 0.5772 to 0.6248 0.565 to 0.637 W/K 100%" in table
    assert "95% interval if fixed numbers are exact if they are 10% off" in table
    assert "noise." not in table
    assert "initial." not in table


def test_the_picture_is_of_the_channel_that_fails_and_of_another_in_the_unseen_window(run):
    words, text = first_screen(one_channel_fails(run))
    assert "Window “test”, which was not trained on" in words["picture"]
    figure = drawn(text)["figures"]["figure-1"]
    titles = [annotation["text"] for annotation in figure["layout"]["annotations"]]
    assert titles[0] == "<b>battery temperature: 0% inside, worst of 3</b>"
    assert re.fullmatch(r"<b>(panel|payload) temperature: 9\d% inside</b>", titles[1])
    assert titles[2:] == ["<b>battery heater</b>", "<b>payload heater</b>"]


def test_an_interval_that_says_less_than_training_did_is_of_no_use_however_much_is_inside(run):
    made = one_channel_says_nothing(run)
    (battery,) = wide_intervals(made)
    assert (battery.channel, battery.window) == ("battery_temperature", "test")
    assert battery.width > 40.0 > 4.0 * battery.varies
    assert choose(made).worst == "battery_temperature"
    sharp = made.windows["test"].assign(crps=0.1 * made.windows["test"]["crps"])
    assert not wide_intervals(dataclasses.replace(made, windows=made.windows | {"test": sharp}))


def test_eclipses_are_explained_only_where_there_are_some(run):
    assert "Shaded: eclipse." in first_screen(run)[0]["picture"]
    lit = {name: window.assign(eclipse=1.0 + 0.0 * window["eclipse"]) for name, window in run.windows.items()}
    assert "Shaded" not in first_screen(dataclasses.replace(run, windows=lit))[0]["picture"]


def test_without_a_prediction_it_is_said_in_the_picture_s_place(run):
    words, _ = first_screen(killed_before_a_posterior(run))
    assert "no prediction with an interval" in words["picture"]
    assert "no calibrated numbers: it did not finish" in words["calibrated"]
    assert "No duty cycle is predicted" in words["duty"]
    assert "Nothing is predicted" in words["verdict"]


def test_heaters_are_told_predicted_and_measured(run):
    assert "There are no heaters." in first_screen(no_heaters(run))[0]["duty"]
    assert re.search(
        r"payload_heater test [\d.]+% [\d.]+% [\d.]+% to [\d.]+% ✓ inside", first_screen(good(run))[0]["duty"]
    )
    assert re.search(
        r"battery_heater test 100\.0% .*? ✕ outside payload_heater", first_screen(heater_is_off(run))[0]["duty"]
    )


def test_of_a_heater_without_a_status_it_is_told_what_is_predicted(run):
    words, text = first_screen(status_is_not_measured(run))
    assert re.search(r"payload_heater test – [\d.]+% [\d.]+% to [\d.]+% not measured", words["duty"])
    titles = [annotation["text"] for annotation in drawn(text)["figures"]["figure-1"]["layout"]["annotations"]]
    assert titles[2:] == ["<b>battery heater</b>", "<b>payload heater</b>"]


def test_where_the_status_is_that_of_passes_the_whole_window_stands_beside_it(run):
    assert "whole window" not in first_screen(good(run))[0]["duty"].lower()
    words = first_screen(status_is_of_passes(run))[0]["duty"]
    assert re.search(r"payload_heater test 100\.0% 100\.0% .*? 33\.3% \(33\.3% to 33\.3%\) ✓ inside", words)
    assert "Whole window: of all of its time" in words


def test_of_a_plan_the_extremes_are_told_and_the_verdict_is_that_of_what_is_scored(run):
    assert "plans" not in first_screen(good(run))[0]
    words, _ = first_screen(with_a_plan(run))
    extreme = r"[−\d.]+ \([−\d.]+ to [−\d.]+\) \d\d-\d\d \d\d:\d\d"
    assert re.search(rf"“test.tomorrow” .* panel_temperature {extreme} {extreme} ", words["plans"])
    assert "tomorrow" not in words["verdict"]
    assert words["verdict"].splitlines()[0] == first_screen(good(run))[0]["verdict"].splitlines()[0]


def test_the_chance_that_a_plan_passes_a_limit_stands_beside_its_extreme(run):
    planned = with_a_limit(run)
    words, _ = first_screen(planned)
    lowest, highest = (r"[−\d.]+ \([−\d.]+ to [−\d.]+\) \S+ \S+" for _ in range(2))
    assert re.search(rf"panel_temperature {lowest} [−\d.]+ 25\.0% {highest} – – ", words["plans"])
    assert re.search(rf"battery_temperature {lowest} – – {highest} – – ", words["plans"])
    drawn = next(block.figures[0] for block in plans.panel(planned).blocks if block.kind == "figure")
    limit = float(planned.windows["test.tomorrow"]["lower_limit"][0]) - 273.15
    assert [trace.y[0] for trace in drawn.data if trace.name == "limit"] == [pytest.approx(limit, abs=1e-3)]
    # Masked, temperatures and their limit are less the same constant.
    assert "25.0%" in first_screen(masked(planned))[0]["plans"]


def test_the_picture_is_of_the_channel_whose_noise_is_not_what_was_assumed(run):
    titles = [
        annotation["text"]
        for annotation in drawn(first_screen(bad_model(run))[1])["figures"]["figure-1"]["layout"]["annotations"]
    ]
    assert titles[0].startswith("<b>payload temperature")


def test_a_status_that_is_not_measured_is_said(run):
    assert re.search(
        r"battery_heater test – [\d.]+% .*? not measured", first_screen(status_is_not_measured(run))[0]["duty"]
    )


SCREENS = {"laptop": (1366, 768), "phone": (390, 844)}
SEEN = """<script>
const seen = [];
const words = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
for (let node = words.nextNode(); node; node = words.nextNode()) {
  const range = document.createRange();
  range.selectNodeContents(node);
  const boxes = [...range.getClientRects()].filter((box) => box.width > 0);
  const isSeen = ({ left, right, top, bottom }) => {
    const inside = left >= 0 && right <= innerWidth && top >= 0 && bottom <= innerHeight;
    const there = document.elementFromPoint((left + right) / 2, (top + bottom) / 2);
    return inside && there !== null && (there.contains(node) || node.parentElement.contains(there));
  };
  if (boxes.length > 0 && boxes.every(isSeen)) seen.push(node.data);
}
const cut = [...document.querySelectorAll("#verdict *, header *")].filter((own) => own.scrollWidth > own.clientWidth + 1
  && getComputedStyle(own).display !== "inline").map((own) => own.outerHTML.slice(0, 80));
const sideways = document.documentElement.scrollWidth > innerWidth;
parent.postMessage({ place: PLACE, words: seen.join(" ").split(/\\s+/).join(" "), cut, sideways }, "*");
</script>"""
TOGETHER = """<!DOCTYPE html><title></title><pre></pre><script>
const found = {};
addEventListener("message", ({ data }) => {
  found[data.place] = data;
  document.querySelector("pre").textContent = JSON.stringify(found);
});
</script>"""


def seen_of(pages, folder):
    """Of each page on each screen what can be seen without scrolling; without figures, which take the time."""
    frames = []
    for name, (screen, (width, height)) in itertools.product(pages, SCREENS.items()):
        place = f"{name}_{screen}"
        text = re.sub(r'<script type="text/plain".*?</script>', "", pages[name], flags=re.S)
        probe = SEEN.replace("PLACE", json.dumps(place))
        (folder / f"{place}.html").write_text(text.replace("</body>", f"{probe}</body>"), encoding="utf-8")
        size = f"position: absolute; border: 0; width: {width}px; height: {height}px"
        frames.append(f'<iframe src="{place}.html" style="{size}"></iframe>')
    (folder / "all.html").write_text(TOGETHER + "".join(frames), encoding="utf-8")
    elements, _ = dump(folder / "all.html", folder / "profile")
    return json.loads(html.unescape(re.search("<pre>(.*?)</pre>", elements, re.S).group(1)))


@pytest.fixture(scope="module")
def seen(pages, tmp_path_factory):
    """Of each case on each screen what can be seen without scrolling."""
    return seen_of(pages, tmp_path_factory.mktemp("screens"))


@needs_browser
@pytest.mark.parametrize("screen", SCREENS)
@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_what_is_seen_without_scrolling_gives_the_decision(seen, case, screen):
    found = seen[f"{case.name}_{screen}"]
    assert (found["cut"], found["sideways"]) == ([], False)
    for words in (case.decision, case.reason, f"Next: {case.then}"):
        assert words in found["words"]
