"""The page in a real browser, offline: nothing said on the console, every figure drawn, nothing cut off."""

import html
import json
import re
import shutil
import subprocess
from dataclasses import replace

import pytest

from flightcal.report import write_report
from flightcal.report.page import render
from flightcal.report.run_files import read_run

from .synthetic_run import CHANNELS, HEATERS

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)

needs_browser = pytest.mark.skipif(BROWSER is None, reason="no chromium on this machine (make chromium)")
pytestmark = needs_browser

PROBE = """<script>
const cut = () => [...document.querySelectorAll("main *, header *")].filter((own) => {
  const box = own.getBoundingClientRect();
  const figure = own.closest(".plot > *");
  // Of a figure its words, in the figure; areas reach beyond what is shown.
  if (figure === null ? own.closest(".scroll, .wide, pre") !== null : own.tagName !== "text") return false;
  return box.width > 0 && box.right > (figure ?? document.body).getBoundingClientRect().right + 1;
}).map((own) => own.outerHTML.slice(0, 80));
const folded = document.documentElement.scrollHeight;
const find = setInterval(() => {
  if (document.documentElement.dataset.figures !== "drawn") return;
  clearInterval(find);
  const drawn = () => document.querySelectorAll(".plot[data-drawn]").length;
  const first = { drawn: drawn(), cut: cut(), sideways: document.documentElement.scrollWidth > innerWidth };
  document.querySelector('a[href="#convergence"]').click();
  setTimeout(() => {
    const opened = [...document.querySelectorAll("details.part[open]")].map((own) => own.id);
    const top = document.getElementById("convergence").getBoundingClientRect().top;
    const found = { width: innerWidth, folded, first, opened, top, drawn: drawn(), cut: cut() };
    dispatchEvent(new Event("beforeprint"));
    found.paper = [drawn(), document.querySelectorAll("main details:not([open])").length];
    parent.postMessage(JSON.stringify(found), "*");
  }, 20000);
}, 200);
</script>"""
PHONE = """<!DOCTYPE html><title></title><body style="margin: 0">
<iframe src="probed.html" style="border: 0; width: 390px; height: 844px"></iframe>
<script>addEventListener("message", (event) => (document.title = event.data));</script>"""


def dump(page, profile, *flags: str, make: str = "--dump-dom") -> tuple[str, list[str]]:
    """The page's elements after its scripts have run, and what it said on the console."""
    command = [
        str(BROWSER), "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
        "--disable-background-networking", "--disable-component-update", "--disable-sync", f"--user-data-dir={profile}",
        "--enable-logging=stderr", "--window-size=1300,1000", "--virtual-time-budget=120000", make, *flags,
        page.as_uri(),
    ]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True, timeout=180, check=True)
    return done.stdout, [line for line in done.stderr.splitlines() if "CONSOLE" in line]


@pytest.fixture(scope="module")
def opened(run_directory, tmp_path_factory):
    """One look at the page with all of it open, far from UTC: starting the browser takes most of the time."""
    folder = tmp_path_factory.mktemp("browser")
    # No name resolves: what is not in the file cannot come.
    page = write_report(run_directory, folder / "page.html")
    page.write_text(page.read_text(encoding="utf-8").replace("<details", "<details open"), encoding="utf-8")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TZ", "Pacific/Auckland")
        return dump(page, folder / "profile", "--host-resolver-rules=MAP * ~NOTFOUND")


def test_nothing_is_said_on_the_console(opened):
    assert opened[1] == []


def test_every_figure_is_drawn(opened):
    elements = opened[0]
    places = elements.count('class="plot js-plotly-plot"')
    assert places == 32
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


def test_on_a_phone_nothing_is_cut_off_and_what_is_folded_is_drawn_when_a_link_opens_it(slim_directory, tmp_path):
    run = read_run(slim_directory)
    long = {
        name: window.assign_coords(channel=["battery_pack_temperature_of_inner_cells"])
        for name, window in run.windows.items()
    }
    page = render(replace(run, windows=long))
    (tmp_path / "probed.html").write_text(page.replace("</body>", f"{PROBE}</body>"), encoding="utf-8")
    (tmp_path / "phone.html").write_text(PHONE, encoding="utf-8")
    elements, _ = dump(tmp_path / "phone.html", tmp_path / "profile")
    found = json.loads(html.unescape(re.search("<title>(.*?)</title>", elements).group(1)))
    assert found["width"] == 390
    assert found["folded"] < 4 * 844
    assert found["first"] == {"drawn": 1, "cut": [], "sideways": False}
    assert found["opened"] == ["trust"]
    assert abs(found["top"]) < 200
    assert 1 < found["drawn"] < page.count('class="plot"')
    assert found["cut"] == []
    assert found["paper"] == [page.count('class="plot"'), 0]


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("pdftotext") is None, reason="no pdftotext on this machine (make chromium)")
def test_on_paper_nothing_is_left_out_or_cut(run_directory, tmp_path):
    page = write_report(run_directory, tmp_path / "page.html")
    paper = tmp_path / "page.pdf"
    dump(page, tmp_path / "profile", "--no-pdf-header-footer", make=f"--print-to-pdf={paper}")
    told = subprocess.run(["pdftotext", "-layout", paper, "-"], capture_output=True, text=True, check=True).stdout
    *sheets, last = (" ".join(sheet.split()) for sheet in told.split("\f"))
    assert last == ""
    assert all(len(sheet) > 200 for sheet in sheets)
    titles = re.findall(r'<h\d class="(?:title|heading|question)"[^>]*>(.*?)</h\d>', page.read_text(encoding="utf-8"))
    assert len(titles) > 20
    assert [title for title in map(html.unescape, titles) if title not in " ".join(sheets)] == []
    # A figure and its caption are on one sheet.
    plots = [name.replace("_", " ") for name in (*CHANNELS, *HEATERS)]
    for caption in ("Figure 1.", "Figure 2.", "Figure 4.", "Figure 6a.", "Figure 6b."):
        (sheet,) = (text for text in sheets if caption in text)
        assert [name for name in plots if name not in sheet] == []
    boxes = subprocess.run(["pdftotext", "-bbox", paper, "-"], capture_output=True, text=True, check=True).stdout
    width = float(re.search(r'<page width="([\d.]+)"', boxes).group(1))
    assert max(map(float, re.findall(r'xMax="([\d.]+)"', boxes))) < width - 20
