"""The page as a person uses it: every control, every download, the keyboard alone, other browsers, a notebook."""

from __future__ import annotations

import csv
import dataclasses
import io
import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from browser import opened, run_in_a_shell, settled

import coupled
import surrogate
import thermofem as th
from coupled.explore import MOVED
from thermofem_cli.inputs.page_models import models_of_geometry

pytestmark = pytest.mark.slow

WIDE, PHONE = {"width": 1300, "height": 900}, {"width": 390, "height": 844}
CONTROLS = "input:not([type=hidden]), select, button, summary, #plane"


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    """The page of the reference strip, with all its figures."""
    path = tmp_path_factory.mktemp("strip") / "ring.html"
    models, heat = models_of_geometry(None, accuracy=1e-2)
    coupled.explore(coupled.borghi2021(), models, path, heat=heat)
    return path


class Oxide:
    """A family in the form of `surrogate.family.Family`: the reference strip, warmer and slower with more oxide."""

    names = ("box",)

    class box:  # noqa: N801
        low, high, units = np.array([1e-6]), np.array([3e-6]), ("m",)

    def __init__(self):
        self.middle = surrogate.reduce(th.assemble(th.strip_ring(), 1e-2).system, tolerance=1e-3).model

    def model(self, box, read=None):
        share = (1 + box / 2e-6) / 2
        slow = self.middle.tau > 100e-9
        factor = np.where(slow, share, 1)
        return th.Foster(R=self.middle.R * factor, tau=self.middle.tau * factor)


@pytest.fixture(scope="module")
def family_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("oxide") / "ring.html"
    family = Oxide()
    models = surrogate.judging.ladder.fit_usual(family.model(box=2e-6))
    coupled.explore(coupled.borghi2021(), models, path, family=family)
    return path


def test_the_journey_of_a_new_user(browser, family_file, tmp_path):
    """Drag the laser to where the ring pulses, see Newton's law fail, move the oxide, take the numbers along."""
    with opened(browser, family_file, "#power=3.2&detuning=-25", viewport=WIDE) as page:
        assert "Self-pulsing" not in page.inner_text("#summary")
        plane = page.locator("#plane").bounding_box()
        page.mouse.move(plane["x"] + 0.2 * plane["width"], plane["y"] + 0.7 * plane["height"])
        page.mouse.down()
        page.mouse.move(plane["x"] + 0.55 * plane["width"], plane["y"] + 0.3 * plane["height"], steps=8)
        page.mouse.up()
        settled(
            page,
            "ringPage.shown.trace.cycle && ringPage.shown.trace.request.detuning === 1e9 * ringPage.state().detuning",
        )
        assert "Self-pulsing, settled cycle" in page.inner_text("#summary")
        wrong = re.search(r"Newton's law [+−](\d+)", page.inner_text("#error-now"))
        assert int(wrong[1]) > 10
        before = page.evaluate("ringPage.shown.trace.cycle.period")
        page.fill("#p0", "2.75")
        settled(page, f"ringPage.shown.trace.cycle && ringPage.shown.trace.cycle.period !== {before}")
        cycle = page.evaluate("ringPage.shown.trace.cycle")
        last = page.evaluate("ringPage.shown.trace.pulsing")
        assert cycle["period"] > 1.02 * before
        page.click("#python")
        script = page.input_value("#copied-text")
    (tmp_path / "script.py").write_text(script)
    printed = run_in_a_shell("python script.py", tmp_path)
    assert float(re.search(r"settled: period ([\d.]+)", printed)[1]) == pytest.approx(cycle["period"], rel=1e-6)
    assert float(re.search(r"self-pulsing: period ([\d.]+)", printed)[1]) == pytest.approx(last["period"], rel=1e-6)


def test_another_model_keeps_the_member_as_the_judge(browser, family_file):
    """The period errors are those against the member, whichever model computes the traces."""
    with opened(browser, family_file, "#model=2&p0=2.75", viewport=WIDE) as page:
        assert page.evaluate("document.getElementById('model').selectedOptions[0].text") == "Newton's law"
        names = page.locator("#error > svg").text_content()
        assert "member of the family" not in names
        assert "against member of the family" in page.get_attribute("#error > svg", "aria-label")


def test_every_figure_is_saved(browser, file):
    """SVG that an XML parser reads, and a table of the trace in SI."""
    with opened(browser, file, viewport=WIDE) as page:
        buttons = page.locator("button[data-save]")
        assert buttons.count() == 9
        for button in buttons.all():
            target, kind = button.get_attribute("data-save").split()
            page.wait_for_timeout(700)  # Chromium drops the eleventh of downloads that follow each other at once
            with page.expect_download() as waiting:
                button.click()
            data = waiting.value.path().read_bytes()
            assert waiting.value.suggested_filename == ("trace.csv" if kind == "csv" else f"{target}.{kind}")
            if kind == "svg":
                root = ET.fromstring(data)
                assert root.tag == "{http://www.w3.org/2000/svg}svg"
            else:
                check_table(data.decode(), page)


def test_a_ring_on_one_bus_shows_its_through_port(browser, tmp_path):
    """Its figures have the through power, not the energy, in the place of the drop power."""
    ring = dataclasses.replace(coupled.borghi2021(), drop_rate=0.0, name="on one bus")
    path = tmp_path / "one.html"
    model = th.Foster(R=[1998.1, 5786.2], tau=[55.8e-9, 1.2e-6])
    coupled.explore(ring, {"reference": model}, path)
    with opened(browser, path, viewport=WIDE) as page:
        settled(page, "ringPage.shown.points.length && ringPage.shown.trace")
        for figure in ("traces", "transmission"):
            text = page.locator(f"#{figure}").text_content()
            assert "Through (mW)" in text
            assert "Energy" not in text
        points = page.evaluate("ringPage.shown.points.map((p) => [p.detuning, p.through])")
        dbm = page.evaluate("ringPage.state().power")
        page.screenshot(path=tmp_path / "one.png", full_page=True)
    detuning, through = points[len(points) // 2]
    states = coupled.steady_states(ring, model, power=1e-3 * 10 ** (dbm / 10), detuning=detuning)
    assert np.min(np.abs(states["through"].values / through - 1)) < 1e-6  # both are solved to 1e-9


def check_table(text, page):
    """Two settled cycles, whose drop and absorbed power belong to energy, carriers and heat of each row."""
    rows = list(csv.DictReader(io.StringIO(text)))
    columns = {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}
    period = page.evaluate("ringPage.shown.trace.cycle.period") * 1e-9
    assert columns["time_s"][-1] == pytest.approx(2 * period, rel=1e-12, abs=0)
    ring = coupled.borghi2021()
    energy, carriers = columns["energy_J"], columns["carriers_per_m3"]
    assert columns["drop_W"] == pytest.approx(2 * ring.bus_rate * energy, rel=1e-12, abs=0)
    absorbed = 2 * (ring.loss_rate + ring.eta_fca * carriers + ring.eta_tpa * energy) * energy
    assert columns["absorbed_W"] == pytest.approx(absorbed, rel=1e-9, abs=0)
    # over a cycle what comes in goes out: the rest is what the trapezoidal rule leaves of pulses on uneven steps
    out = columns["drop_W"] + columns["through_W"] + absorbed + 2 * ring.scattering_rate * energy
    power = 1e-3 * 10 ** (page.evaluate("ringPage.state().power") / 10)
    assert np.trapezoid(out, columns["time_s"]) / (2 * period) == pytest.approx(power, rel=5e-3)
    swing = page.evaluate("ringPage.shown.trace.cycle.swing")
    assert np.ptp(columns["delta_T_K"]) == pytest.approx(swing, rel=1e-3)  # the samples pass the top by little


def test_every_control_moves_its_own_number(browser, file):
    with opened(browser, file, viewport=WIDE) as page:
        for name in (*MOVED, "power", "detuning", "duration"):
            before = page.evaluate("ringPage.state()")
            value = float(page.input_value(f"#{name}-slider"))
            page.evaluate(
                "([id, v]) => { const s = document.getElementById(id); s.value = v;"
                " s.dispatchEvent(new Event('input')); }",
                [f"{name}-slider", value - 40],
            )
            after = page.evaluate("ringPage.state()")
            assert after[name] != before[name], name
            assert {k: v for k, v in after.items() if k != name} == {k: v for k, v in before.items() if k != name}
            assert float(page.input_value(f"#{name}")) == pytest.approx(after[name], rel=1e-9)
        page.click("#reset")
        assert [page.evaluate("ringPage.state()")[k] for k in MOVED] == [None] * len(MOVED)
        page.select_option("#ring", label="Van Vaerenbergh 2012")
        settled(page, "ringPage.shown.trace.request.ring.name.startsWith('Van')")
        page.select_option("#model", index=2)
        settled(page, "ringPage.shown.trace.request.model.name === 'second order'")
        page.select_option("#preset", index=1)
        settled(page, "ringPage.shown.trace.request.ring.name.startsWith('Borghi')")
        for view, told in (("last", "last cycle of"), ("cycle", "settled cycle"), ("cold", "last cycle of")):
            page.check(f"input[value={view}]")
            page.wait_for_function(f"document.getElementById('summary').textContent.includes('{told}')", timeout=30_000)
        ground = "getComputedStyle(document.body).backgroundColor"
        light = page.evaluate(ground)
        page.click("#theme")
        assert page.evaluate(ground) != light
        page.click("#play")
        page.wait_for_function("ringPage.shown.phase > 0.02")
        page.click("#play")
        page.evaluate("const s = document.getElementById('phase'); s.value = 0.5; s.dispatchEvent(new Event('input'));")
        period = page.evaluate("ringPage.shown.trace.cycle || ringPage.shown.trace.pulsing")["period"]
        assert page.inner_text("#phase-text") == f"{period / 2:.0f} ns of {period:.0f} ns"


@pytest.mark.parametrize("size", [WIDE, PHONE])
def test_the_keyboard_alone(browser, file, size):
    """Tab reaches every control in the order of the page; arrows, Space and Enter work them; the focus is seen."""
    with opened(browser, file, viewport=size) as page:
        page.evaluate("document.getElementById('more').open = true")
        wanted = page.evaluate(
            "q => Array.from(document.querySelectorAll(q)).filter(e => e.checkVisibility() && !e.disabled"
            " && !(e.type === 'radio' && !e.checked)).map(e => e.id || e.dataset.save || e.tagName + (e.value || ''))",
            CONTROLS,
        )
        reached, seen = [], []
        for _ in wanted:
            page.keyboard.press("Tab")
            name, outline = page.evaluate(
                "() => { const e = document.activeElement, s = getComputedStyle(e);"
                " return [e.id || e.dataset.save || e.tagName + (e.value || ''), s.outlineStyle]; }"
            )
            reached.append(name)
            seen.append(outline != "none")
        assert reached == wanted
        assert all(seen)
        for name, before, after in (("power", 8, 7.95), ("detuning", 0, -0.1)):
            assert page.evaluate("ringPage.state()")[name] == before
            page.focus(f"#{name}-slider")
            page.keyboard.press("ArrowLeft")
            assert page.evaluate("ringPage.state()")[name] == after
        page.focus("input[value=cycle]")
        page.keyboard.press("ArrowDown")
        assert page.evaluate("ringPage.state().view") == "last"
        page.focus("#preset")
        page.keyboard.press("ArrowDown")
        assert page.evaluate("ringPage.state().power") == 8
        page.focus("#python")
        page.keyboard.press("Enter")
        assert page.input_value("#copied-text").startswith("import coupled")
        page.focus("#play")
        page.keyboard.press("Space")
        page.wait_for_function("ringPage.shown.phase > 0.02")
        page.keyboard.press("Space")


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        (lambda text: text.replace("(() => {\n", "(() => { let broken = #x;\n", 1), "older than 2023"),
        (lambda text: text.replace("(() => {\n", "(() => { throw 1;\n", 1), "older than 2023"),
        (lambda text: text[: int(0.3 * len(text))], "cut short"),
        (lambda text: text[: int(0.98 * len(text))], "cut short"),
    ],
    ids=["unknown syntax", "a start that fails", "cut early", "cut late"],
)
def test_an_old_browser_or_a_file_that_is_cut_gets_a_plain_message(browser, file, tmp_path, changed, words):
    (tmp_path / "bad.html").write_text(changed(file.read_text(encoding="utf-8")), encoding="utf-8")
    page = browser.new_page()
    page.goto((tmp_path / "bad.html").as_uri())
    page.wait_for_selector("#notice", state="visible")
    assert words in page.inner_text("#notice")
    assert not page.is_visible("#page") or words == "cut short"
    page.close()


def test_in_a_notebook_it_stands_in_a_frame(browser, tmp_path):
    """As a notebook shows an object: its HTML within the notebook's own page."""
    model = th.Foster(R=[1998.1, 5786.2], tau=[55.8e-9, 1.2e-6])
    shown = coupled.explore(coupled.borghi2021(), {'"two" <poles>': model})._repr_html_()
    path = tmp_path / "notebook.html"
    path.write_text(f"<!doctype html><title>notebook</title><body><div class='output'>{shown}</div>", encoding="utf-8")
    page = browser.new_page()
    problems = []
    page.on("console", lambda message: problems.append(message.text) if message.type == "error" else None)
    page.goto(path.as_uri())
    frame = page.frame_locator("iframe")
    frame.locator("#summary", has_text="period 685.9").wait_for(timeout=60_000)
    frame.locator("#link").click()
    assert frame.locator("#copied-text").input_value().startswith("ring.html#")
    assert problems == []
    page.close()
