"""The report page: in a real browser, from the disk, made of a real comparison."""

import contextlib
import io
import json
import sys
from itertools import combinations

import numpy as np
import pytest

from agents.benchmark import compare
from agents.benchmark.report import command as report
from agents.benchmark.report.curves import error_bands, rounded
from agents.benchmark.report.episode import episode_cell, fly_episode, shown_policies
from agents.benchmark.report.leaderboard import ALL_MODES, leaderboard
from agents.benchmark.report.looks import place
from agents.benchmark.report.page import first_shown, page, page_data, rebuild
from agents.docs import readme
from baselines import BASELINES, make_baseline
from baselines.command.cli import exit_code
from satid_gym.evaluation import benchmark_scenario, fly
from satid_gym.files import read_json
from tests.cases import cases

pytestmark = pytest.mark.slow  # in a browser

POLICIES = ("chirp", "rate_square", "zero", "generalist")


def call(module, line):
    """Exit code and standard output of a command line."""
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(io.StringIO()) as output:
        patch.setattr(sys, "argv", [module.__name__, *line.split()])
        code = exit_code(module.main)
    return code, output.getvalue()


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Where a small comparison has written its files."""
    path = tmp_path_factory.mktemp("results")
    code, printed = call(
        compare, f"--satellites microsat --modes step --policies {' '.join(POLICIES)} --episodes 2 --output {path}"
    )
    assert code == 0
    assert str(path / "report.html") in printed.replace("\n", "")
    return path


@pytest.fixture
def opened(browser, folder):
    """Opens the page as a user would, and says at the end whether it complained or asked for anything."""
    complaints, requests, contexts = [], [], []

    def open_page(**options):
        contexts.append(browser.new_context(**options))
        page = contexts[-1].new_page()
        page.on("console", lambda message: complaints.append(message.text))
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on("request", lambda request: requests.append(request.url))
        page.goto((folder / "report.html").as_uri())
        page.wait_for_selector("#episode-charts .main-svg")
        return page

    yield open_page
    for context in contexts:
        context.close()
    assert complaints == []
    assert requests == [(folder / "report.html").as_uri()] * len(contexts)


@pytest.fixture
def crowded(browser, folder, tmp_path):
    """Opens the page of the committed results, with all policies and cells; the episode is the small comparison's."""
    results = read_json(readme.RESULTS / "compare.json", "restore it")
    curves = json.loads((folder / "report_data.json").read_text())
    (tmp_path / "report.html").write_text(page(results, curves))
    contexts = []

    def open_page(width):
        contexts.append(browser.new_context(viewport={"width": width, "height": 844}, is_mobile=width < 500))
        opened = contexts[-1].new_page()
        opened.goto((tmp_path / "report.html").as_uri())
        opened.wait_for_selector("#episode-charts .main-svg")
        return opened

    yield open_page
    for context in contexts:
        context.close()


# in the browser


def clock(page):
    """Seconds into the episode that the page shows."""
    return float(page.locator("#clock").inner_text().split()[0])


def wait_until(page, condition, seconds=20.0):
    """Playwright's own waiting evaluates strings, which the page's content policy forbids."""
    for _ in range(int(seconds / 0.05)):
        if condition():
            return
        page.wait_for_timeout(50)
    pytest.fail(f"still not so after {seconds:g} s")


def test_it_opens_from_the_disk_with_all_sections_filled(opened, folder):
    assert (folder / "report.html").stat().st_size < 5_000_000
    page = opened(viewport={"width": 1280, "height": 900})
    for chart in ("#time-panels", "#effort-chart", "#outside-chart"):
        assert page.locator(f"{chart} .scatterlayer .trace").count() >= 4
    assert page.locator("#episode-charts .js-plotly-plot").count() == 8
    assert page.locator("#views canvas").count() == 2
    assert page.locator("#heatmap tbody tr").count() == len(POLICIES) + 2
    made = page.locator("#made").inner_text()
    results = json.loads((folder / "compare.json").read_text())
    for fact in (
        results["command"],
        results["revision"],
        "test seeds 3000000000 to 3000000001",
        f"numpy {np.__version__}",
    ):
        assert fact in made


def test_its_figures_are_those_of_the_results(opened, folder):
    page = opened()
    records = json.loads((folder / "compare.json").read_text())["records"]
    for r in records:
        row = page.locator(
            "#leaderboard-table tbody tr", has=page.get_by_role("rowheader", name=r["policy"], exact=True)
        )
        shown = row.locator("td").first.inner_text().translate(str.maketrans("", "", "[]*")).split()
        expected = [100 * r[f"final_error_{end}"] for end in ("mean", "lo", "hi")]
        assert [float(x) for x in shown] == pytest.approx(expected, rel=6e-3)
        assert f"{r['reward']:.0f}" in row.locator("td").all_inner_texts()


def test_the_table_sorts_by_click_and_key_and_keeps_the_bounds_last(opened):
    page = opened()

    def order():
        names = page.locator("#leaderboard-table tbody th").all_inner_texts()
        assert [name.strip() for name in names[-2:]] == ["bound", "reference_limit"]
        return [name.strip() for name in names[:-2]]

    head = page.locator("#leaderboard-table th", has=page.locator("button[data-key=policy]"))
    assert head.get_attribute("aria-sort") == "none"
    assert page.locator("#leaderboard-table th[aria-sort=ascending]").inner_text().startswith("final error")
    head.locator("button").click()
    assert head.get_attribute("aria-sort") == "ascending"
    assert order() == sorted(POLICIES)
    page.keyboard.press("Enter")  # the button has kept the focus
    assert head.get_attribute("aria-sort") == "descending"
    assert order() == sorted(POLICIES, reverse=True)
    page.locator("button[data-key=effort]").focus()
    page.keyboard.press("Space")
    assert order()[0] == "zero"


def test_policies_can_be_switched_in_the_error_chart(opened):
    page = opened()

    def drawn():
        return page.evaluate("document.querySelector('#time-panels .chart').data.map((t) => t.name).filter(Boolean)")

    assert sorted(drawn()) == ["chirp", "generalist", "rate_square"]
    assert page.evaluate("document.querySelector('#time-panels .chart').layout.yaxis.type") == "log"
    page.get_by_label("chirp", exact=True).uncheck()
    page.get_by_label("bound", exact=True).check()
    assert sorted(drawn()) == ["bound", "generalist", "rate_square"]


def test_the_flight_plays_pauses_and_scrubs(opened):
    page = opened()

    def picture():
        return page.evaluate("document.querySelector('#views canvas').toDataURL()")

    assert clock(page) == 0.0
    first = picture()
    page.click("#play")
    wait_until(page, lambda: clock(page) > 2.0)
    page.click("#play")
    paused, later = clock(page), picture()
    assert later != first
    page.wait_for_timeout(300)
    assert clock(page) == paused
    page.locator("#views canvas").first.focus()
    page.keyboard.press("ArrowLeft")
    assert picture() != later  # seen from elsewhere
    assert clock(page) == paused
    page.locator("#scrub").fill("150.5")
    assert clock(page) == 150.5
    page.locator("#views canvas").first.focus()
    page.keyboard.press("Space")
    wait_until(page, lambda: clock(page) > 151.0)
    assert page.locator("#play").inner_text() == "Pause"


def test_who_asks_for_less_motion_gets_still_pictures(opened):
    page = opened(reduced_motion="reduce")
    page.click("#play")
    wait_until(page, lambda: clock(page) > 0.0)
    assert clock(page) >= 10.0  # a second at 10 x, in one go
    assert "one still picture a second" in page.locator("#flight-note").inner_text()


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_on_a_phone_nothing_is_wider_than_the_screen(opened, scheme):
    page = opened(viewport={"width": 390, "height": 844}, is_mobile=True, has_touch=True, color_scheme=scheme)
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    wide = page.evaluate(
        "[...document.querySelectorAll('body *')].filter((e) => !e.closest('.scroll *, svg, .hidden') && "
        "e.getBoundingClientRect().right > 390.5).map((e) => e.outerHTML.slice(0, 80))"
    )
    assert wide == []
    background = page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert (background == "rgb(255, 255, 255)") == (scheme == "light")


def test_the_scenario_stands_in_the_title_and_in_every_heading_of_results(opened):
    page = opened()
    assert page.title().endswith("scenario default")
    assert page.locator("h1").inner_text().endswith("scenario default")
    headings = page.locator("main h2").all_inner_texts()
    assert all("scenario default" in heading for heading in headings[:-1]), headings
    assert "scenario default, microsat, step" in headings[0]


def test_any_policy_can_fly_the_episode_alone_or_next_to_another(opened):
    page = opened()

    def titles():
        return [title.split()[0] for title in page.locator("#views h3").all_inner_texts()]

    assert titles() == ["chirp", "generalist"]
    assert set(page.locator("#pilot-0 option").all_inner_texts()) == set(POLICIES)
    page.select_option("#pilot-0", "zero")
    assert titles() == ["zero", "generalist"]
    assert "zero (reference, inside the envelope" in page.locator("#episode-note").inner_text()
    page.select_option("#pilot-1", "")
    assert titles() == ["zero"]
    assert page.locator("#episode-charts .js-plotly-plot").count() == 4
    page.select_option("#pilot-1", "rate_square")
    assert page.locator("#episode-charts .js-plotly-plot").count() == 8
    page.locator("#scrub").fill("20")
    assert clock(page) == 20.0


def test_errors_are_drawn_in_standard_deviations(opened, folder):
    page = opened()
    chart = "document.querySelectorAll('#episode-charts .js-plotly-plot')[3]"  # the second policy's
    drawn = page.evaluate(f"{chart}.data.filter((t) => t.customdata).map((t) => [t.y, t.customdata])")
    episode = json.loads((folder / "report_data.json").read_text())["episode"]
    (flight,) = (f for f in episode["flights"] if f["policy"] == "generalist")
    sigmas = (np.array(flight["estimate"]) - episode["inertia"]) / np.array(flight["sigma"])
    np.testing.assert_allclose([sigma for _, sigma in drawn], sigmas, rtol=1e-9)
    near = np.abs(sigmas) <= 3.0
    heights = np.array([height for height, _ in drawn])
    np.testing.assert_allclose(heights[near], sigmas[near] / 3.0, rtol=1e-9)  # linear inside three of them
    np.testing.assert_allclose(np.abs(heights[~near]), 1.0 + np.log10(np.abs(sigmas[~near]) / 3.0), rtol=1e-9)
    share = 100.0 * near.mean(axis=1)
    words = page.locator("#episode-charts p.note", has_text="generalist, within").inner_text().replace("\u00a0", " ")
    assert f"x {share[0]:.1f} %, y {share[1]:.1f} %, z {share[2]:.1f} % of the time" in words


@pytest.mark.parametrize("width", [390, 1280])
def test_no_text_of_a_chart_covers_another(crowded, width):
    page = crowded(width)
    boxes = page.evaluate(
        "[...document.querySelectorAll('.js-plotly-plot, #colour-scale, .gauges, .controls, .legend')].map((box) => "
        "[...box.querySelectorAll('.xtick text, .ytick text, .annotation text, .xtitle, .ytitle, span, label, output')]"
        ".filter((e) => !e.querySelector('span') && e.textContent.trim() && !e.closest('.hidden')).map((e) => {"
        "const r = e.getBoundingClientRect(); return [e.textContent, r.left, r.top, r.right, r.bottom]; }))"
    )
    assert sum(map(len, boxes)) > 100
    covered = [
        (one[0], other[0])
        for texts in boxes
        for one, other in combinations(texts, 2)
        if min(one[3], other[3]) - max(one[1], other[1]) > 1 and min(one[4], other[4]) - max(one[2], other[2]) > 3
    ]
    assert covered == []


def test_stored_figures_are_marked_on_the_page_and_have_no_curves(browser, folder, tmp_path):
    """Also where they are of one satellite alone."""
    results = json.loads((folder / "compare.json").read_text())
    curves = json.loads((folder / "report_data.json").read_text())
    other = [{**r, "satellite": "cubesat"} for r in results["records"]]
    results["settings"]["satellites"] = ["microsat", "cubesat"]
    results["records"] += other
    planned = [{**r, "policy": "mpc"} for r in other if r["policy"] == "rate_square"]
    made = {"file": "old/compare.json", "revision": "earlier", "command": "c", "efficiencies": [], "notes": ["A note"]}
    (tmp_path / "report.html").write_text(page({**results, "stored": {**made, "records": planned}}, curves))
    complaints = []
    opened = browser.new_page()
    opened.on("console", lambda message: complaints.append(message.text))
    opened.on("pageerror", lambda error: complaints.append(str(error)))
    opened.goto((tmp_path / "report.html").as_uri())
    opened.wait_for_selector("#episode-charts .main-svg")
    assert "mpc (stored)" not in opened.locator("#leaderboard-table").inner_text()  # of microsat
    opened.select_option("#satellite", "cubesat")
    assert "mpc (stored)" in opened.locator("#leaderboard-table").inner_text()
    assert "mpc" not in opened.locator("#time-legend").inner_text()
    row = opened.locator("#heatmap tr", has_text="mpc (stored)")
    assert row.locator("td").all_inner_texts()[0] == "-"
    assert (
        "old/compare.json, revision earlier; not flown in this comparison. A note"
        in opened.locator("#provenance").inner_text()
    )
    opened.close()
    assert complaints == []


# from the disk


def test_the_page_can_be_made_again_from_the_files_next_to_it(folder):
    page = folder / "report.html"
    before = page.read_text()
    page.unlink()
    code, printed = call(report, f"--results {folder}")
    assert (code, printed.strip()) == (0, f"{page} written")
    assert page.read_text() == before


def test_the_results_hold_no_bulk(folder):
    results = json.loads((folder / "compare.json").read_text())
    assert not {"curves", "episode"} & set(results)


def test_missing_and_unlike_files_are_refused(folder, tmp_path, capsys):
    assert call(report, f"--results {tmp_path}")[0] == 2
    assert f"{tmp_path / 'compare.json'} is missing: run python -m agents.compare" in capsys.readouterr().err
    for name in ("compare.json", "report_data.json"):
        values = json.loads((folder / name).read_text())
        (tmp_path / name).write_text(json.dumps(values | ({"revision": "another"} if name == "compare.json" else {})))
    with pytest.raises(ValueError, match=r"come from different comparisons \(not the same revision\)"):
        rebuild(tmp_path, "default")
    assert not (tmp_path / "report.html").exists()


# what it is made of


def test_bands_by_hand():
    error = np.array([np.arange(11.0), np.full(11, 0.12345)])
    bands = error_bands(error)
    assert bands == {"low": [1.0, 0.123], "median": [5.0, 0.123], "high": [9.0, 0.123]}
    assert rounded(np.array([1234.56, -0.000123456]), 2) == [1200.0, -0.00012]


@cases(
    ("file", "name", "value"),
    [
        ("compare", "records", 5),
        ("compare", "records", [{"policy": "sine"}]),
        ("compare", "settings", []),
        ("compare", "settings", {"satellites": 3, "modes": ["step"]}),
        ("compare", "bounds", [7]),
        ("compare", "efficiencies", None),
        ("compare", "seeds", 1),
        ("compare", "revision", 1),
        ("report_data", "curves", {}),
        ("report_data", "episode", []),
        ("report_data", "bounds", 0.5),
        ("report_data", "time", "long"),
    ],
)
def test_damaged_results_end_the_command_in_a_line(file, name, value, folder, tmp_path, capsys):
    for path in folder.glob("*.json"):
        whole = json.loads(path.read_text())
        if path.stem == file:
            whole[name] = value
        (tmp_path / path.name).write_text(json.dumps(whole))
    code, _ = call(report, f"--results {tmp_path}")
    errors = capsys.readouterr().err
    assert (code, errors.count("\n")) == (2, 1)
    assert f"{file}.json is damaged: " in errors
    assert name in errors
    assert "run python -m agents.compare again" in errors
    assert not (tmp_path / "report.html").exists()


def entry(policy, kind, mode, error, outside=0.0, **changed):
    base = dict.fromkeys(
        ("nees", "information_nats", "effort", "saturated_fraction", "terminated_fraction", "reward"), 0.0
    )
    errors = {f"{name}_error_{end}": error for name in ("final", "mean") for end in ("mean", "lo", "hi")}
    cell = {"policy": policy, "kind": kind, "satellite": "s", "inertia_mode": mode, "outside_fraction": outside}
    return {**base, **errors, **cell, "time_to_1pct_s": 2.0, **changed}


RESULTS = {
    "records": [
        entry("wild", "reference", "static", 0.001, outside=0.5),
        entry("wild", "reference", "step", 0.001, outside=0.5),
        entry("held", "reference", "static", 0.001, saturated_fraction=0.5),
        entry("held", "reference", "step", 0.001, saturated_fraction=0.5),
        entry("sine", "scripted", "static", 0.002),
        entry("sine", "scripted", "step", 0.006, time_to_1pct_s=None),
        entry("net", "learned", "static", 0.003, outside=0.01),
        entry("net", "learned", "step", 0.004, outside=0.01),
    ],
    "bounds": [
        {"policy": "bound", "kind": "bound", "satellite": "s", "inertia_mode": mode, "final_error": error}
        for mode, error in (("static", 1e-4), ("step", 3e-4))
    ],
    "efficiencies": [],
}


def test_leaderboard_by_hand():
    static = leaderboard(RESULTS, "s", "static")
    assert [row["policy"] for row in static] == ["wild", "held", "sine", "net", "bound"]
    assert [row["policy"] for row in static if row["best"]] == ["sine"]  # who is beyond it half of the time cannot be
    assert [row["inside"] for row in static[:-1]] == [False, False, True, True]
    mean = leaderboard(RESULTS, "s", ALL_MODES)
    assert [row["policy"] for row in mean if row["best"]] == ["net"]
    by_name = {row["policy"]: row for row in mean}
    assert by_name["sine"]["final_error_mean"] == pytest.approx(0.004)
    assert by_name["sine"]["time_to_1pct_s"] is None
    assert by_name["sine"]["final_error_lo"] is None
    assert by_name["bound"]["final_error_mean"] == pytest.approx(2e-4)


def headline(browser, tmp_path, records):
    """What the page's headline says of a cell of these records."""
    settings = {"satellites": ["s"], "modes": ["static"], "scenario": "tight", "output": "results"}
    seeds = {"split": "test", "first": 0, "count": 2}
    made = {"command": "c", "revision": "r", "versions": {}, "settings": settings, "seeds": seeds}
    flight = {"policy": records[0]["policy"], "kind": records[0]["kind"], "error": [0.1, 0.1]}
    flight |= {name: [[1.0, 1.0]] * 3 for name in ("estimate", "sigma", "rate", "wheel_speed", "momentum")}
    episode = {"satellite": "s", "inertia_mode": "static", "seed": 0, "horizon": 1.0, "size": [1, 1, 1]}
    episode |= {"rate_limit": 1.0, "wheel_axes": np.eye(3).tolist(), "wheel_speed_limit": [1, 1, 1]}
    episode |= {"shown": [records[0]["policy"]], "time": [0.0, 1.0], "inertia": [[1.0, 1.0]] * 3}
    episode["flights"] = [flight | {"attitude": [[0.0, 0.0]] * 3 + [[1.0, 1.0]]}]
    file = tmp_path / "report.html"
    results = {**made, "records": records, "bounds": [], "efficiencies": []}
    file.write_text(page(results, {"time": [1.0], "curves": [], "bounds": [], "episode": episode}))
    opened = browser.new_page()
    opened.goto(file.as_uri())
    opened.wait_for_selector("#headline:not(:empty)")
    assert "scenario tight" in opened.title()
    said = opened.locator("#headline").inner_text().replace("\u00a0", " ")
    opened.close()
    return said


def test_the_headline_names_no_error_from_outside_the_envelope_without_saying_so(browser, tmp_path):
    inside, outside = {"outside": 0.0}, {"outside": 0.5}
    loop = entry("loop", "closed_loop", "static", 0.002, **inside)
    records = [loop, entry("net", "learned", "static", 0.001, **outside), entry("tame", "learned", "static", 0.003)]
    said = headline(browser, tmp_path, records)
    assert said == "Lowest final error inside the envelope: loop 0.200 %. Best learned inside it: tame 0.300 %."
    records = [loop, entry("net", "learned", "static", 0.001, **outside)]
    assert headline(browser, tmp_path, records) == (
        "Lowest final error inside the envelope: loop 0.200 %. No learned policy keeps to it; the lowest error of "
        "those, outside it: net 0.100 %."
    )
    said = headline(browser, tmp_path, records[1:])
    assert said.startswith("No policy keeps to the envelope. No learned policy keeps to it; the lowest")


def test_a_policy_looks_the_same_on_every_page():
    """Its place among the looks of its kind is its own, whoever else is on the page."""
    made = {name: {} for name in ("command", "revision", "seeds", "versions")}
    curves = {"time": [], "curves": [], "bounds": [], "episode": {}}
    settings = {"satellites": ["s"], "modes": ["static"]}

    def places(*names):
        records = [entry(name, "scripted", "static", 0.1) for name in names]
        results = {**made, "settings": settings, "records": records, "bounds": [], "efficiencies": []}
        return {policy["name"]: policy["place"] for policy in page_data(results, curves)["policies"]}

    alone, together = places("chirp"), places("one_step", "sine", "chirp", "runs/mine/policy")
    assert alone["chirp"] == together["chirp"]
    assert places("runs/mine/policy")["runs/mine/policy"] == together["runs/mine/policy"]
    assert len({place(name) for name in BASELINES}) == len(BASELINES)


def test_who_is_shown():
    assert first_shown(RESULTS) == ["net", "sine"]
    step = [r for r in RESULTS["records"] if r["inertia_mode"] == "step"]
    assert shown_policies(step) == ["sine", "net"]
    assert shown_policies([r for r in step if r["kind"] == "reference"]) == ["wild"]
    assert episode_cell(["cubesat", "microsat"], ["static", "step"]) == ("microsat", "step")
    assert episode_cell(["smallsat"], ["drift"]) == ("smallsat", "drift")


def test_the_episode_is_the_one_that_was_compared():
    cell = {"satellite": "cubesat", "scenario": benchmark_scenario()}
    policy = make_baseline("rate_square", "cubesat")
    flight = fly(policy, inertia="drift", seeds=[7], **cell)
    episode = fly_episode([policy], mode="drift", seed=7, **cell)
    (shown,) = episode["flights"]
    assert episode["time"][2::2] == flight.time.tolist()
    np.testing.assert_allclose(shown["error"][2::2], flight.error[:, 0], rtol=1e-3)
    np.testing.assert_allclose(np.linalg.norm(shown["attitude"], axis=0), 1.0, atol=1e-4)


def test_a_flight_that_is_terminated_ends_there():
    cell = {"satellite": "cubesat", "scenario": benchmark_scenario()}
    policy = make_baseline("random", "cubesat")
    alive = fly(policy, inertia="static", seeds=[0], **cell).alive[:, 0]
    episode = fly_episode([policy, make_baseline("zero", "cubesat")], mode="static", seed=0, **cell)
    ended, whole = episode["flights"]
    assert not alive.all()
    assert alive.sum() - 1.0 <= episode["time"][len(ended["error"]) - 1] <= alive.sum()
    assert len(whole["error"]) == len(episode["time"]) == len(episode["inertia"][0])
