"""The report in a browser: views follow the chosen pilot, show what the result files say, and can be walked by keys."""

from __future__ import annotations

import csv
import io
import json
import math
import re
from typing import Any

import numpy as np
import pytest
from browser.conftest import PICTURES, Made
from PIL import Image

from pilotgen.context import EvaluationContext
from pilotgen.evaluation import Evaluation, evaluate
from pilotgen.objectives import GAIN_MARGIN
from pilotgen.report.findings import worst_order

CANVASES = (
    "#cloud",
    "#front",
    "#histogram",
    "#nyquist",
    "#bode-grip",
    "#bode-grip-phase",
    "#bode-loop",
    "#bode-loop-phase",
)


def painted(page: Any, selector: str) -> str:
    """What a view's canvas shows."""
    page.wait_for_timeout(60)
    content: str = page.eval_on_selector(f"{selector} canvas", "canvas => canvas.toDataURL()")
    return content


def colours(page: Any, selector: str) -> int:
    """How many different colours an element shows."""
    page.locator(selector).scroll_into_view_if_needed()
    page.wait_for_timeout(200)
    with Image.open(io.BytesIO(page.locator(selector).screenshot())) as picture:
        return len(picture.convert("RGB").getcolors(maxcolors=1 << 24))


def test_numbers_of_the_page_are_those_of_the_results(made: Made, opened: Any) -> None:
    page, results = opened(made.address), made.results
    rows = np.flatnonzero(results.columns["status"] == "ok")
    for name in ("gain_margin_db", "phase_margin_deg", "modulus_margin", "mass_kg", "grip_motion_3hz_mm_per_m_s2"):
        found = page.evaluate(
            "([key, rows]) => rows.map(k => String(pilotgen.model.value(key, k)))", [name, rows.tolist()]
        )
        values = np.array([float(text.replace("Infinity", "inf")) for text in found])
        np.testing.assert_allclose(values, results.columns[name][rows], rtol=1e-8)
    found = page.evaluate("rows => rows.map(k => pilotgen.model.grip(k, 3, false))", rows.tolist())
    motion = [1e3 * math.hypot(*pair) for pair in found]
    np.testing.assert_allclose(motion, results.columns["grip_motion_3hz_mm_per_m_s2"][rows], rtol=1e-6)


def test_curves_are_those_of_the_loop(made: Made, opened: Any) -> None:
    page = opened(made.address)
    with EvaluationContext(made.study) as context:
        for k in worst_order(made.results)[[0, 5, -1]].tolist():
            values = dict(zip(made.results.names, made.results.columns["inputs"][k].tolist(), strict=True))
            outcome = evaluate(context, made.study.values(values))
            assert isinstance(outcome, Evaluation)
            hz = np.geomspace(0.1, 20.0, 40)
            expected = outcome.loop.response(2.0 * np.pi * hz)
            found = np.array(page.evaluate("([k, hz]) => hz.map(f => pilotgen.model.loop(k, f))", [k, hz.tolist()]))
            np.testing.assert_allclose(found[:, 0] + 1j * found[:, 1], expected, rtol=1e-6)
            for crossing in outcome.result["loop"]["crossings"]:
                re, im = page.evaluate("([k, f]) => pilotgen.model.loop(k, f)", [k, crossing["frequency_hz"]])
                assert abs(complex(re, im) - complex(crossing["real"], crossing["imag"])) < 1e-6
            disk = page.evaluate("k => pilotgen.model.disk(k)", k)
            assert disk["value"] == pytest.approx(outcome.result["loop"]["disk_margin"], rel=1e-6)


def test_choosing_a_pilot_moves_every_view(made: Made, opened: Any) -> None:
    page = opened(made.address)
    page.evaluate("pilotgen.wake()")
    order = worst_order(made.results).tolist()
    assert page.evaluate("pilotgen.state.pilot") == order[0] and page.inner_text("#who") == "worst pilot"
    before = {name: painted(page, name) for name in CANVASES}
    skeleton = page.evaluate("pilotgen.figure.picture()")
    other = order[len(order) // 2]
    page.locator("#cloud").scroll_into_view_if_needed()
    x, y = page.evaluate("k => pilotgen.views.cloud.screen(k)", other)
    page.locator("#cloud .u-over").click(position={"x": x, "y": y})
    assert page.evaluate("pilotgen.state.pilot") == other
    assert all(painted(page, name) != before[name] for name in CANVASES)
    assert page.evaluate("pilotgen.figure.shown") == other and page.evaluate("pilotgen.figure.picture()") != skeleton
    place = order.index(other) + 1
    assert page.inner_text("#who") == f"pilot {other + 1} ({place} of {len(order)} from the worst)"
    assert page.get_attribute(f'#pilots tr[data-pilot="{other}"]', "aria-selected") == "true"
    gain = made.results.columns[GAIN_MARGIN.key][other]
    assert f"{gain:.2f} dB" in page.inner_text("#margins")
    assert f"stature_m={made.results.columns['inputs'][other, 2]!r}".replace("np.float64(", "").rstrip(
        ")"
    ) in page.inner_text("#command")
    page.locator("#front .u-over").click(
        position=dict(zip("xy", page.evaluate("k => pilotgen.views.front.screen(k)", order[0]), strict=True))
    )
    near = page.evaluate("pilotgen.state.pilot")
    assert abs(made.results.columns[GAIN_MARGIN.key][near] - made.results.columns[GAIN_MARGIN.key][order[0]]) < 0.2


def test_hover_on_the_nyquist_curve_lights_the_same_frequency_everywhere(made: Made, opened: Any) -> None:
    page = opened(made.address)
    page.locator("#nyquist").scroll_into_view_if_needed()
    before = {name: painted(page, name) for name in CANVASES[4:]}
    hz, left, top = page.evaluate(
        """() => {
          const curve = pilotgen.model.curve(pilotgen.state.pilot), { u } = pilotgen.views.nyquist.view;
          let k = 0;
          while (curve.hz[k] < 3) k += 1;
          return [curve.hz[k], u.valToPos(curve.re[k], "x"), u.valToPos(curve.im[k], "y")];
        }"""
    )
    page.locator("#nyquist .u-over").hover(position={"x": left, "y": top})
    assert page.evaluate("pilotgen.state.hz") == pytest.approx(hz, rel=0.02)  # a mouse stands on whole pixels
    found = page.evaluate("pilotgen.state.hz")
    assert page.inner_text(".tip").startswith(f"{found:.3f} Hz")
    re, im = page.evaluate("pilotgen.model.loop(pilotgen.state.pilot, pilotgen.state.hz)")
    gain, phase = 20.0 * math.log10(math.hypot(re, im)), math.degrees(math.atan2(im, re))
    told = page.inner_text("#readout").replace("−", "-")
    assert f"{found:.3f} Hz: loop gain {gain:.2f} dB, phase {phase:.1f}°" in told
    assert f"gain {gain:.2f} dB" in page.inner_text(".tip").replace("−", "-")
    assert all(painted(page, name) != before[name] for name in before)


def test_the_pilot_in_3d_stands_where_the_deck_has_him(made: Made, opened: Any) -> None:
    page = opened(made.address)
    page.evaluate("pilotgen.wake()")
    assert colours(page, "#figure canvas") > 200  # not blank
    worst = int(worst_order(made.results)[0])
    values = dict(zip(made.results.names, made.results.columns["inputs"][worst].tolist(), strict=True))
    with EvaluationContext(made.study) as context:
        outcome = evaluate(context, made.study.values(values))
    assert isinstance(outcome, Evaluation) and outcome.solved is not None and outcome.solved.matrices is not None
    nodes = outcome.solved.matrices.nodes
    for look in ("front", "side", "top", "reset"):
        page.click(f'[data-look="{look}"]')
        view = page.evaluate("pilotgen.figure.view()")
        eye, target = np.array(view["eye"]), np.array(view["target"])
        ahead = (target - eye) / np.linalg.norm(target - eye)
        right = np.cross(ahead, [0.0, 1.0, 0.0])
        right /= np.linalg.norm(right)
        up = np.cross(right, ahead)
        wide, high = view["size"]
        for name in (b"hand_l", b"lever", b"ulna_l"):
            along = nodes.position[list(nodes.name).index(name)] - eye
            scale = 0.5 * high / math.tan(math.radians(view["fov_deg"]) / 2.0) / (along @ ahead)
            expected = [0.5 * wide + scale * (along @ right), 0.5 * high - scale * (along @ up)]
            found = page.evaluate("name => pilotgen.figure.project(name, 'nodes')", name.decode())
            np.testing.assert_allclose(found, expected, atol=0.05)
        if look != "reset":
            assert colours(page, "#figure canvas") > 100


def test_hover_in_3d_tells_joint_angles_and_activations(made: Made, opened: Any) -> None:
    page = opened(made.address)
    page.evaluate("pilotgen.wake()")
    page.click('[data-look="side"]')
    page.locator("#figure").scroll_into_view_if_needed()
    told = set()
    ends = page.evaluate("['elbow_l', 'wrist_l', 'shoulder_l'].map(name => pilotgen.figure.project(name))")
    for first, second in ((0, 1), (0, 2)):
        for share in (0.1, 0.3, 0.5, 0.7, 0.9):
            x, y = ((1 - share) * np.array(ends[first]) + share * np.array(ends[second])).tolist()
            page.locator("#figure canvas").hover(position={"x": x, "y": y})
            told.add(page.inner_text(".tip"))
    joints = page.evaluate("pilotgen.model.data.skeletons.each[pilotgen.figure.shown].joints")
    shown = f"{joints['shoulder_flexion_deg']:.1f}°".replace("-", "−")
    assert any("humerus, left" in text and f"shoulder flexion {shown}" in text for text in told)
    assert any(re.search(r"^\w+_l\nactivation 0\.\d{3}", text) for text in told)


def test_modes_and_responses_move_him(made: Made, opened: Any) -> None:
    page = opened(made.address)
    page.evaluate("pilotgen.wake()")
    still = page.evaluate("pilotgen.figure.place('lever_grip')")
    page.select_option("#motion", "mode")
    page.click("#play")  # stop where he is
    page.evaluate("pilotgen.figure.at(0)")
    swung = page.evaluate("pilotgen.figure.place('lever_grip')")
    assert math.dist(still, swung) == pytest.approx(30e-3, rel=0.01)  # the grip moves 30 mm: the slider's number
    page.select_option("#motion", str(1 + 5))  # 3 Hz
    page.click("#play")
    worst = int(worst_order(made.results)[0])
    at = []
    for quarter in range(4):
        page.evaluate("phase => pilotgen.figure.at(phase)", 0.5 * math.pi * quarter)
        places = page.evaluate("['lever_grip', 'lever_hinge'].map(pilotgen.figure.place)")
        at.append(np.subtract(*places))
    amplitude = np.linalg.norm(0.5 * ((at[0] - at[2]) - 1j * (at[1] - at[3])))
    motion = 1e-3 * made.results.columns["grip_motion_3hz_mm_per_m_s2"][worst]
    assert amplitude == pytest.approx(30.0 * motion, rel=0.01)  # relative to the seat, 30 times


def test_keys(made: Made, opened: Any) -> None:
    page = opened(made.address)
    order = page.evaluate("pilotgen.state.order")
    page.keyboard.press("ArrowRight")
    assert page.evaluate("pilotgen.state.pilot") == order[1]
    page.keyboard.press("Shift+ArrowRight")
    assert page.evaluate("pilotgen.state.hz") == pytest.approx(3.06)
    names = []
    for _ in range(60):
        page.keyboard.press("Tab")
        names.append(page.evaluate("(e => e.id || e.tagName + (e.dataset.look || ''))(document.activeElement)"))
    wanted = ["worse", "chooser", "better", "colour", "cloud-x", "histogram-of", "BUTTONfront", "motion", "play"]
    wanted += ["figure", "copy", "filter", "csv"]
    assert [name for name in names if name in wanted] == wanted  # in the order of the page
    page.locator("#pilots tbody tr").first.focus()
    page.keyboard.press("ArrowDown")
    page.keyboard.press("ArrowDown")
    page.keyboard.press("Enter")
    assert page.evaluate("pilotgen.state.pilot") == order[2]


def test_table_sorts_filters_and_is_taken_away(made: Made, opened: Any) -> None:
    page, columns = opened(made.address), made.results.columns
    page.click('#pilots button:has-text("stature")')
    assert page.get_attribute('#pilots th:has-text("stature")', "aria-sort") == "ascending"
    page.click('#pilots button:has-text("stature")')
    tallest = int(np.argmax(np.where(columns["status"] == "ok", columns["inputs"][:, 2], 0.0)))
    assert page.get_attribute("#pilots tbody tr", "data-pilot") == str(tallest)
    page.fill("#filter", "stature_m>1.7 gain_margin_db<8")
    kept = np.flatnonzero((columns["inputs"][:, 2] > 1.7) & (columns["gain_margin_db"] < 8.0))
    with page.expect_download() as waiting:
        page.click("#csv")
    with open(waiting.value.path(), encoding="utf-8") as file:
        lines = list(csv.DictReader(file))
    assert sorted(int(line["pilot"]) for line in lines if line["pilot"] != "nominal") == kept.tolist()
    for line in lines:
        if line["pilot"] != "nominal":
            k = int(line["pilot"])
            assert float(line["gain_margin_db"]) == columns["gain_margin_db"][k]  # to the last digit
            assert float(line["stature_m"]) == columns["inputs"][k, 2]
    with page.expect_download() as waiting:
        page.click("#json")
    with open(waiting.value.path(), encoding="utf-8") as file:
        people = json.load(file)
    assert len(people) == len(lines) and people[0]["command"].startswith("pilotgen pilot study.yaml -o replay --set ")
    page.fill("#filter", "nobody>3")
    assert "no column is called nobody" in page.inner_text("#table")


def test_deck_in_the_fold_is_the_deck(made: Made, opened: Any) -> None:
    page = opened(made.address)
    page.evaluate("k => pilotgen.state.choose(k)", int(made.results.front[0]))
    page.click("#deck summary")
    page.wait_for_selector("#deck pre")
    text = page.eval_on_selector("#deck pre", "pre => pre.textContent")
    assert text == (made.directory / "front" / "01" / "pilot.mbd").read_text()
    assert page.get_attribute("#deck a", "href") == "front/01/pilot.mbd"
    assert page.locator("#deck .deck-comment").count() > 10 and page.locator("#deck .deck-number").count() > 100


def test_markup_in_names_stays_text(made: Made, opened: Any) -> None:
    page = opened(made.address)
    assert "<b>quick</b> & small" in page.inner_text("body")
    assert page.locator("b, i").count() == 0
    assert "collective of the <i>Puma</i><script>alert(2)</script>" in page.inner_text("body")
    assert "<script>alert(3)</script> fly." in page.inner_text("body") and "<i>cell</i>" in page.inner_text("body")
    assert page.evaluate("pilotgen.model.data.study.name") == "<b>quick</b> & small"
    page.click("text=study file")
    assert '<script>alert("study")</script>' in page.inner_text("details pre")


@pytest.mark.parametrize("width", [1400, 800, 390])
def test_three_widths(made: Made, opened: Any, width: int) -> None:
    page = opened(made.address, width=width)
    page.locator("#figure").scroll_into_view_if_needed()
    page.wait_for_selector("#figure canvas")
    page.wait_for_timeout(300)
    assert page.evaluate("document.documentElement.scrollWidth") <= width  # nothing sticks out
    shifts = page.evaluate(
        """() => new Promise(done => {
          let sum = 0;
          const watch = new PerformanceObserver(list => list.getEntries().forEach(entry => { sum += entry.value; }));
          watch.observe({ type: "layout-shift", buffered: true });
          setTimeout(() => done(sum), 100);
        })"""
    )
    assert shifts < 0.05  # nothing jumps
    PICTURES.mkdir(parents=True, exist_ok=True)
    page.screenshot(path=PICTURES / f"report-{width}.png", full_page=True)


CONTRAST = """() => {
  const rgb = text => text.match(/[\\d.]+/g).map(Number);
  const linear = v => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4;
  const light = colour => [0.2126, 0.7152, 0.0722].reduce((sum, part, k) => sum + part * linear(colour[k] / 255), 0);
  function paper(element) {
    for (let e = element; e; e = e.parentElement) {
      const colour = rgb(getComputedStyle(e).backgroundColor);
      if (colour.length < 4 || colour[3] > 0) return colour;
    }
    return [255, 255, 255];
  }
  const found = [];
  for (const element of document.querySelectorAll("body *")) {
    const own = [...element.childNodes].some(node => node.nodeType === 3 && node.textContent.trim());
    if (!own || !element.getClientRects().length || ["SCRIPT", "STYLE", "OPTION"].includes(element.tagName)) continue;
    const [a, b] = [light(rgb(getComputedStyle(element).color)), light(paper(element))].sort((x, y) => y - x);
    const ratio = (a + 0.05) / (b + 0.05);
    if (ratio < 4.5) found.push(`${element.tagName} ${element.textContent.slice(0, 30)}: ${ratio.toFixed(2)}`);
  }
  return found;
}"""


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_letters_stand_out_and_everything_has_a_name(made: Made, opened: Any, scheme: str) -> None:
    page = opened(made.address, color_scheme=scheme)
    assert page.evaluate(CONTRAST) == []  # WCAG AA
    assert page.evaluate("[...document.images].filter(i => !i.alt).length") == 0
    unnamed = """[...document.querySelectorAll("button, select, input")].filter(e =>
      !(e.textContent.trim() && e.tagName === "BUTTON") && !e.labels?.length && !e.ariaLabel).map(e => e.id)"""
    assert page.evaluate(unnamed) == []
    assert page.evaluate("[...document.querySelectorAll('.host')].every(e => e.getAttribute('aria-label'))")
    if scheme == "dark":
        page.evaluate("pilotgen.wake()")
        page.wait_for_timeout(200)
        page.screenshot(path=PICTURES / "report-dark.png", full_page=True)


def test_without_scripts_it_is_the_still_page(made: Made, opened: Any) -> None:
    page = opened(made.address, java_script_enabled=False)
    assert "Who is the worst pilot?" in page.inner_text("body")
    assert not page.locator(".live").first.is_visible()
    pictures = page.locator("figure.still img")
    assert pictures.count() == 7 and all(pictures.nth(k).is_visible() for k in range(7))


def test_a_browser_that_cannot_do_it_gets_the_still_page(made: Made, browser: Any) -> None:
    page = browser.new_page()
    page.add_init_script("delete window.IntersectionObserver; delete window.ResizeObserver")
    page.goto(made.address)
    page.wait_for_timeout(300)
    assert page.locator("figure.still img").first.is_visible() and not page.locator(".live").first.is_visible()
    page.context.close()


def test_prints_to_pages_of_a4(made: Made, opened: Any) -> None:
    page = opened(made.address)
    PICTURES.mkdir(parents=True, exist_ok=True)
    data = page.pdf(prefer_css_page_size=True, path=PICTURES / "report.pdf")
    assert data[:4] == b"%PDF"
    sizes = set(re.findall(rb"/MediaBox \[0 0 ([\d.]+) ([\d.]+)\]", data))
    assert sizes == {(b"594.95996", b"841.91998")} or all(
        abs(float(w) - 595) < 1 and abs(float(h) - 842) < 1 for w, h in sizes
    )
    page.emulate_media(media="print")
    assert page.locator("figure.still img").first.is_visible() and not page.locator("#nyquist").is_visible()
    assert page.locator("#command").is_visible() and not page.locator("#copy").is_visible()
