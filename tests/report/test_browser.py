"""The page in a real browser, offline: no error on the console, every figure drawn."""

import re
import shutil
import subprocess

import pytest

from flightcal.report import write_report

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)

pytestmark = pytest.mark.skipif(BROWSER is None, reason="no chromium on this machine (make chromium)")


def dump(page, profile, *flags: str) -> tuple[str, list[str]]:
    """The page's elements after its scripts have run, and what it said on the console."""
    command = [
        str(BROWSER), "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
        "--disable-background-networking", "--disable-component-update", "--disable-sync", f"--user-data-dir={profile}",
        "--enable-logging=stderr", "--window-size=1300,1000", "--virtual-time-budget=120000", "--dump-dom", *flags,
        page.as_uri(),
    ]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True, timeout=180, check=True)
    return done.stdout, [line for line in done.stderr.splitlines() if "CONSOLE" in line]


@pytest.fixture(scope="module")
def opened(run_directory, tmp_path_factory):
    """One look at the page, far from UTC: starting the browser takes most of the time."""
    folder = tmp_path_factory.mktemp("browser")
    # No name resolves: what is not in the file cannot come.
    page = write_report(run_directory, folder / "page.html")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TZ", "Pacific/Auckland")
        return dump(page, folder / "profile", "--host-resolver-rules=MAP * ~NOTFOUND")


def test_nothing_is_said_on_the_console(opened):
    assert opened[1] == []


def test_every_figure_is_drawn(opened):
    elements = opened[0]
    places = elements.count('class="plot js-plotly-plot"')
    assert places == 31
    assert elements.count('data-drawn="light"') == places
    assert 'data-figures="drawn"' in elements
    assert len(re.findall(r'class="xaxislayer-above|class="xlines-above', elements)) >= places


def test_traces_have_points(opened):
    elements = opened[0]
    assert len(re.findall(r'<path class="js-line"', elements)) > 100
    assert len(re.findall(r'<path class="point', elements)) > 3_000


def test_the_time_axis_is_utc_wherever_the_reader_is(opened):
    dated = re.findall(r">([\d:]+)</tspan><tspan[^>]*>(Mar \d, 2024)</tspan>", opened[0])
    assert set(dated) == {("00:00", "Mar 1, 2024"), ("02:00", "Mar 2, 2024")}


def test_no_button_can_send_a_chart_away(opened):
    titles = set(re.findall(r'data-title="([^"]*)"', opened[0]))
    assert titles == {"Download plot as a PNG", "Zoom", "Pan", "Zoom in", "Zoom out", "Reset axes"}
