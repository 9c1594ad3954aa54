"""The page in a browser: it starts, answers, needs no network, restores a link, and takes no bad number."""

from __future__ import annotations

import re
from dataclasses import asdict

import numpy as np
import pytest
from browser import opened, settled

import coupled
import surrogate
import thermofem as th
from coupled.parameters import NEWTON_MAPS

pytestmark = pytest.mark.slow

HOSTILE = '</script><b>&two</b> "poles"'
MODELS = {
    "slow heat": th.Foster(R=[600, 1500, 2000, 2200, 1500], tau=[20e-9, 100e-9, 400e-9, 2e-6, 12e-6]),
    HOSTILE: th.Foster(R=[1998.1, 5786.2], tau=[55.8e-9, 1.2e-6]),
}  # fmt: skip


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "ring.html"
    coupled.explore(coupled.borghi2021(), MODELS, path)
    return path


@pytest.fixture
def page(browser, file):
    with opened(browser, file, viewport={"width": 1300, "height": 900}) as page:
        yield page


def test_it_starts_with_the_settled_cycle(page):
    """654.4757927 ns is this model's own period at 8 dBm on resonance (a 300 us trace at rtol 1e-8)."""
    text = page.inner_text("#summary")
    assert "Self-pulsing, settled cycle: period 654.48 ns" in text
    assert page.evaluate("ringPage.shown.trace.cycle.period") == pytest.approx(654.4757930, rel=1e-6)


def test_names_are_text(page):
    assert page.evaluate("document.querySelectorAll('#page b').length") == 0
    assert HOSTILE in page.evaluate("Array.from(document.querySelectorAll('#model option'), o => o.text)")


def test_a_number_out_of_range_is_marked_and_not_taken(page):
    before = page.evaluate("ringPage.state().power")
    page.fill("#power", "400")
    assert page.get_attribute("#power", "aria-invalid") == "true"
    assert "from -40 to 27 dBm" in page.inner_text("#power-problem")
    assert page.evaluate("ringPage.state().power") == before
    page.fill("#power", "7")
    assert page.get_attribute("#power", "aria-invalid") == "false"
    assert page.evaluate("ringPage.state().power") == 7
    page.fill("#loadedQ", "500000")
    assert "below the intrinsic one" in page.inner_text("#loadedQ-problem")


def test_the_value_under_the_pointer(page):
    """(8 dBm, -20 GHz) is 6.31 mW, and 161 pm on the red side: lambda^2/c times 20 GHz."""
    box, (x, y) = (
        page.locator("#plane").bounding_box(),
        page.evaluate("[ringPage.shown.plane.x(-20), ringPage.shown.plane.y(8)]"),
    )
    page.mouse.move(box["x"] + x, box["y"] + y)
    power, milliwatts, detuning, picometres = map(float, re.findall(r"-?\d+\.?\d*", page.inner_text("#pointed")))
    assert (power, milliwatts, detuning) == pytest.approx((8, 6.31, -20), rel=0.02)
    assert picometres == pytest.approx(20e9 * 299792458 / coupled.borghi2021().frequency ** 2 * 1e12, rel=0.02)
    assert "R_th = 7.800 K/mW" in page.inner_text("#numbers")


def test_milliwatts_and_picometres(page):
    """5 mW is 6.99 dBm; 100 pm on the red side is -c 100 pm/lambda^2; a range is given in the same unit."""
    page.select_option("#units", "pm")
    page.fill("#power", "5")
    page.fill("#detuning", "100")
    state = page.evaluate("ringPage.state()")
    assert state["power"] == pytest.approx(10 * np.log10(5), rel=1e-12)
    moved = -1e-10 * coupled.borghi2021().frequency ** 2 / 299792458 / 1e9
    assert state["detuning"] == pytest.approx(moved, rel=1e-12)
    page.fill("#power", "9000")
    assert "from 0.0001 to 501.187 mW" in page.inner_text("#power-problem")
    assert "Power (mW)" in page.inner_text("#plane")
    settled(page)
    assert "Wavelength from the cold resonance (pm)" in page.inner_text("#transmission")


def test_values_of_any_figure_and_what_is_zoomed_in_to(page):
    """A rectangle becomes the axes, a double click gives them back; on the plane the map is computed in the window."""
    page.wait_for_function("ringPage.shown.map && ringPage.shown.map.n === 140", timeout=60_000)
    axes = "ringPage.shown.panels.traces[0].x.scale"
    span, (left, right) = page.evaluate(f"{axes}.domain()"), page.evaluate(f"{axes}.domain().map({axes})")
    box = page.locator("#traces").bounding_box()
    page.mouse.move(box["x"] + left + (right - left) / 4, box["y"] + 40)
    at = float(re.match(r"Time ([\d.]+) ns, Drop [\d.]+ mW", page.inner_text("#readout"))[1])
    assert at == pytest.approx(span[1] / 4, rel=0.01)
    page.mouse.down()
    page.mouse.move(box["x"] + left + (right - left) / 2, box["y"] + 70, steps=3)
    page.mouse.up()
    page.wait_for_function(f"{axes}.domain()[0] > 0")
    assert page.evaluate(f"{axes}.domain()") == pytest.approx([span[1] / 4, span[1] / 2], rel=0.01)
    page.mouse.dblclick(box["x"] + 150, box["y"] + 50)
    page.wait_for_function(f"{axes}.domain()[0] === 0")
    page.click("button[data-zoom='0.5']")  # about 8 dBm, 0 GHz
    page.wait_for_function("ringPage.shown.map.window.detuning[0] === -15")
    assert page.evaluate("ringPage.shown.map.window.power") == [5.5, 9]
    page.click("button[data-zoom='0']")
    page.wait_for_function("ringPage.shown.map.window.detuning[0] === -30")


def test_a_kept_setting_lies_under_the_next_one(page):
    before = page.evaluate("ringPage.shown.trace.cycle.period")
    page.click("#keep")
    page.fill("#power", "7.5")
    settled(page, f"ringPage.shown.trace.cycle && ringPage.shown.trace.cycle.period !== {before}")
    assert f"period {before:.2f} ns" in page.inner_text("#kept")
    for name in ("traces", "phase-portrait", "transmission", "step"):
        assert page.locator(f"#{name} path[stroke-dasharray='5 3']").count() >= 1
    page.click("#keep")
    assert page.inner_text("#kept") == ""


def test_the_laser_is_moved_with_the_keyboard(page):
    page.focus("#plane")
    page.keyboard.press("ArrowRight")
    page.keyboard.press("ArrowUp")
    state = page.evaluate("ringPage.state()")
    assert (state["detuning"], state["power"]) == pytest.approx((0.6, 8.07))


def restored(browser, link, page):
    """A link opens what the page shows."""
    other = browser.new_page(bypass_csp=True)
    other.goto(link)
    settled(other)
    assert other.evaluate("ringPage.state()") == page.evaluate("ringPage.state()")
    assert other.inner_text("#summary") == page.inner_text("#summary")
    other.close()


def test_a_link_restores_the_view(page, browser, file):
    page.fill("#power", "6.125")
    page.fill("#lifetime", "21.5")
    page.check("input[value=last]")
    settled(page)
    page.click("#link")
    link = page.input_value("#copied-text")
    restored(browser, link, page)


@pytest.mark.parametrize(("loaded", "own"), [(2000, 5000), (300000, 900000), (3000, 2e6)])
def test_a_link_restores_both_quality_factors(browser, file, loaded, own):
    """The two are judged together, not each beside the other of the ring, 6622 and 110173."""
    for link in (f"#loadedQ={loaded}&intrinsicQ={own}", f"#intrinsicQ={own}&loadedQ={loaded}"):
        with opened(browser, file, link) as page:
            state = page.evaluate("ringPage.state()")
            assert (state["loadedQ"], state["intrinsicQ"]) == (loaded, own)
            assert page.inner_text("#link-problem") == ""


@pytest.mark.parametrize(
    ("link", "words"),
    [
        ("loadedQ=9000&intrinsicQ=5000", "Loaded Q = 9000: The loaded quality factor must lie below"),
        ("loadedQ=1&intrinsicQ=5000", "Intrinsic Q = 5000: The loaded quality factor must lie below"),
        ("power=400", "Power in the bus = 400: Give a value from -40 to 27 dBm."),
        ("power=", "Power in the bus = NaN: This is not a number."),
        ("ring=99", "ring = 99: This page has no such setting."),
        ("view=warm", "view = warm: This page has no such setting."),
    ],
)
def test_what_a_link_holds_and_cannot_be_taken_is_said(browser, file, link, words):
    """Nothing is left out without a word."""
    with opened(browser, file, f"#{link}&detuning=-3") as page:
        state = page.evaluate("ringPage.state()")
        assert (state["power"], state["loadedQ"], state["intrinsicQ"], state["detuning"]) == (8, None, None, -3)
        assert words in page.inner_text("#link-problem")
        page.fill("#power", "7")
        assert page.inner_text("#link-problem") == ""
        page.evaluate("location.hash = 'power=400'")  # a link that is followed inside the page
        page.wait_for_function("document.getElementById('link-problem').textContent !== ''")


def test_the_copied_script_gives_the_same_numbers(page, capsys):
    """Period, duty and swing of the last cycle of the same run, to the digits that the page prints."""
    moved = {"loadedQ": 7000, "lifetime": 30, "volume": 5.1, "absorbed": 0.9, "thermoOptic": 1.9, "resistance": 7.5}
    for name, value in moved.items():
        page.fill(f"#{name}", str(value))
    page.check("input[value=last]")
    settled(page)
    page.click("#python")
    script = page.input_value("#copied-text")
    made = {}
    exec(compile(script, "copied", "exec"), made)
    ring, paper = made["ring"], coupled.borghi2021()
    assert ring.loaded_q == pytest.approx(7000, rel=1e-12)
    assert ring.intrinsic_q == pytest.approx(paper.intrinsic_q, rel=1e-12)
    assert ring.carriers.tau0 == pytest.approx(30e-9, rel=1e-12, abs=0)
    assert ring.tpa_volume == pytest.approx(5.1e-18, rel=1e-12, abs=0)
    assert ring.fca_volume / ring.tpa_volume == pytest.approx(paper.fca_volume / paper.tpa_volume, rel=1e-12)
    assert ring.loss_rate / (ring.loss_rate + ring.scattering_rate) == pytest.approx(0.9, rel=1e-12)
    assert ring.thermo_optic == pytest.approx(1.9e-4, rel=1e-12, abs=0)
    assert made["model"].thermal_resistance == pytest.approx(7500, rel=1e-12)
    assert "R_th = 7.500 K/mW" in page.inner_text("#numbers")
    printed = capsys.readouterr().out
    period = float(re.search(r"period ([\d.]+) ns", printed)[1])
    assert period == pytest.approx(page.evaluate("ringPage.shown.trace.pulsing.period"), rel=1e-6)


def test_the_plane_shows_where_cycles_fold(browser, tmp_path):
    """Newton's law of the paper's maps, until a number of the ring moves."""
    ring, newton = coupled.borghi2021().with_lumped_fcd(), surrogate.newton(**asdict(NEWTON_MAPS))
    coupled.explore(ring, {"Newton": newton}, tmp_path / "ring.html")
    with opened(browser, tmp_path / "ring.html") as page:
        page.wait_for_function("document.querySelector('#plane').textContent.includes('fold of cycles')")
        page.fill("#loadedQ", "6000")
        page.wait_for_function("!document.querySelector('#plane').textContent.includes('fold of cycles')")


@pytest.mark.parametrize("width", [390, 1300])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_accessible_by_the_rules_of_axe_and_no_wider_than_the_window(browser, file, width, scheme):
    axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="axe-playwright-python is not installed")
    page = browser.new_page(viewport={"width": width, "height": 900}, color_scheme=scheme, bypass_csp=True)
    page.goto(file.as_uri())
    settled(page)
    page.evaluate("document.getElementById('more').open = true")
    report = axe.Axe().run(page).response
    assert len(report["passes"]) > 20
    assert [f"{v['id']}: {v['nodes'][0]['html'][:200]}" for v in report["violations"]] == []
    assert page.evaluate("document.documentElement.scrollWidth - window.innerWidth") <= 0
    page.close()


def test_the_file_is_small_and_needs_nothing_else():
    text = coupled.explore(coupled.borghi2021(), MODELS).html
    assert len(text.encode()) < 2_000_000
    assert not re.search(r"""(src|href)=["'](https?:)?//""", text)


class Stack:
    """A family in the form of `surrogate.family.Family`: more oxide makes the core warmer and slower."""

    names = ("box", "width")

    class box:  # noqa: N801
        low, high, units = np.array([1e-6, 0.4e-6]), np.array([3e-6, 0.6e-6]), ("m", "m")

    def model(self, box, width, read=None):
        return th.Foster(R=[1500 * 0.45e-6 / width, 2e3 + 2e9 * box], tau=[50e-9, 1.2e-6 * (box / 2e-6)])


@pytest.fixture(scope="module")
def family_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("family") / "ring.html"
    coupled.explore(coupled.borghi2021(), path=path, family=Stack())
    return path


def test_a_family_moves_the_geometry(browser, family_file):
    """The page's member has the member's R_th, which is linear in the oxide here, and the copied script its poles."""
    page = browser.new_page(bypass_csp=True)
    page.goto(family_file.as_uri())
    settled(page)
    before = page.evaluate("ringPage.shown.trace.pulsing.period")
    page.fill("#p0", "2.7")
    page.fill("#p1", "0.4")
    page.wait_for_function("ringPage.shown.trace.request.quick === false && ringPage.state().p0 === 2.7 && ringPage.state().p1 === 0.4 && Math.abs(ringPage.shown.trace.request.model.R.reduce((a, b) => a + b) - 9087) < 20", timeout=60_000)  # fmt: skip  # noqa: E501
    model = page.evaluate("ringPage.shown.trace.request.model")
    exact = Stack().model(box=2.7e-6, width=0.4e-6)
    assert sum(model["R"]) == pytest.approx(exact.thermal_resistance, rel=2e-3)  # width enters as 1/width
    times = np.geomspace(1e-9, 1e-4, 30)
    steps = th.Foster(R=model["R"], tau=model["tau"]).step_response(times)
    stated = float(re.search(r"within ([\d.e-]+) %", page.inner_text("body"))[1]) / 100
    assert np.abs(steps - exact.step_response(times)).max() < 1.5 * stated * exact.thermal_resistance
    assert page.evaluate("ringPage.shown.trace.pulsing.period") != pytest.approx(before, rel=1e-3)
    page.fill("#p0", "9")
    assert "from 1 to 3 µm" in page.inner_text("#p0-problem")
    page.close()


HEATED = th.StateSpace(
    np.diag([55.8e-9, 1.2e-6]), -np.eye(2), np.array([[1998.1, -100.0], [5786.2, 1100.0]]), np.ones((1, 2)),
    inputs=("core", "heater"), outputs=("core",),
)  # fmt: skip


@pytest.fixture(scope="module")
def heater_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("heater") / "ring.html"
    models = {"with a heater": HEATED, "without": th.Foster(R=[7e3], tau=[1e-6])}
    coupled.explore(coupled.borghi2021(), models, path, heaters={"heater": 1e-3})
    return path


def test_a_heater_moves_the_resonance(browser, heater_file, capsys):
    """10 K/mW of the ring's own numbers: 1 K at 1 mW. The script gives the settled cycle, the link the view."""
    page = browser.new_page(bypass_csp=True)
    page.goto(heater_file.as_uri())
    settled(page)
    assert page.input_value("#h0") == "1"
    shift = float(re.search(r"mW; ([\d.]+) pm/K; heater to core: 1.000 K/mW, ", page.inner_text("#numbers"))[1])
    assert f"heater to core: 1.000 K/mW, {shift:.1f} pm/mW" in page.inner_text("#numbers")  # 1 K/mW: 1100 - 100 K/W
    assert "heater to core" in page.inner_html("#step")
    assert float(page.evaluate("ringPage.setting(ringPage.shown.trace.request).rise")) == pytest.approx(1, rel=1e-12)
    page.fill("#h0", "8")
    page.wait_for_function("ringPage.shown.map && ringPage.shown.map.window.detuning[0] < -100", timeout=60_000)
    middle = sum(page.evaluate("ringPage.shown.map.window.detuning")) / 2
    assert middle == pytest.approx(-coupled.borghi2021().thermal_shift * 8 / (2e9 * np.pi), rel=1e-9)  # 1 K/mW
    assert page.evaluate("[0, 1, 2].every(kind => ringPage.shown.map.stable.includes(kind))")
    page.fill("#h0", "2.5")
    page.fill("#detuning", "-25")
    page.wait_for_function("ringPage.shown.trace.request.quick === false && ringPage.shown.trace.request.detuning === -25e9", timeout=60_000)  # fmt: skip  # noqa: E501
    page.click("#python")
    exec(compile(page.input_value("#copied-text"), "copied", "exec"), {})
    period = float(re.search(r"settled: period ([\d.]+) ns", capsys.readouterr().out)[1])
    assert period == pytest.approx(page.evaluate("ringPage.shown.trace.cycle.period"), rel=1e-6)
    page.click("#link")
    restored(browser, page.input_value("#copied-text"), page)
    page.select_option("#model", "1")  # Newton's law, without a heater
    assert page.is_disabled("#h0")
    assert "no such heater" in page.inner_text("#h0-problem")
    page.close()
