"""The live page in headless Chromium. GONIO_SCREENSHOT=docs/images/live.png keeps a picture of it."""

import os
from pathlib import Path

import pytest

CHROMIUM = Path("/usr/bin/chromium")
ARGS = (
    "--headless --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking "
    "--disable-component-update --disable-sync"
).split()
PICTURE = os.environ.get("GONIO_SCREENSHOT")


@pytest.fixture(scope="module")
def browser():
    api = pytest.importorskip("playwright.sync_api", reason="needs playwright, of the extra `dev`")
    if not CHROMIUM.exists():
        pytest.skip(f"needs {CHROMIUM}")
    with api.sync_playwright() as p:
        b = p.chromium.launch(executable_path=str(CHROMIUM), args=ARGS)
        yield b
        b.close()


MEASURED = "Number(document.getElementById('measured').textContent.replace(/[^0-9]/g, ''))"


def until(page, wanted, seconds=300):
    """Until the expression is true in a picture that the page draws; its policy forbids `wait_for_function`."""
    page.evaluate(f"""async () => {{
      for (const end = performance.now() + {1000 * seconds}; !({wanted}); await new Promise(requestAnimationFrame))
        if (performance.now() > end) throw new Error("waited in vain");
    }}""")


def test_a_run_is_watched_paused_and_stopped(daemon, browser):
    page = browser.new_page(viewport={"width": 1360, "height": 900})
    errors, elsewhere = [], []
    page.on("pageerror", lambda e: errors.append(str(e)))
    page.on("console", lambda m: errors.append(m.text) if m.type == "error" else None)
    page.on(
        "request", lambda r: None if r.url.startswith((daemon.url.split("?")[0], "data:")) else elsewhere.append(r.url)
    )
    page.goto(daemon.url)
    job = daemon.acquire("page", 100_000)
    badge = page.locator("#state")
    page.locator("#run", has_text="runs/page").wait_for()
    until(page, f"{MEASURED} >= 60")
    assert page.locator("#rig").text_content() == "sim · devices"
    assert page.locator(".axis").count() == 4 and "°" in page.locator(".axis .angle").first.text_content()
    assert "homed" in page.locator("#devices").text_content()
    assert page.locator("#acceptance").text_content().endswith("%")
    assert page.evaluate("dome.rows.length") >= 60
    drawn = (
        "[...document.getElementById('hemisphere').getContext('2d').getImageData(0, 0, 600, 500).data].some(v => v > 0)"
    )
    assert page.evaluate(drawn)
    page.get_by_role("button", name="Pause").click()
    page.get_by_role("button", name="Continue").wait_for()
    assert badge.text_content() == "paused" and daemon.state()["state"] == "paused"
    page.get_by_role("button", name="Continue").click()
    page.get_by_role("button", name="Pause").wait_for()
    page.get_by_role("button", name="Stop").click()
    page.locator("#message", has_text="stopped by the operator").wait_for()
    assert badge.text_content() == "idle" and daemon.ended(job)["code"] == 130
    assert not errors and not elsewhere
    page.close()


def test_a_sample_is_asked_for_and_put_in(daemon, browser):
    page = browser.new_page()
    page.goto(daemon.url)
    settings = ["--set", "name=felt", "--set", "sample_id=A7", "--set", "budget.measurements=20"]
    assert daemon.gonio("queue", "add", "analytic_gloss", *settings).returncode == 0
    assert daemon.gonio("queue", "run").returncode == 0
    page.locator("#message", has_text="Put in felt (A7), then Continue").wait_for()
    page.get_by_role("button", name="Continue").click()
    page.locator("#message", has_text="budget of 20 measurements").wait_for()
    page.close()


def test_without_the_token_there_is_no_page(daemon, browser):
    page = browser.new_page()
    assert page.goto(daemon.url.split("?")[0]).status == 401
    page.close()


def test_a_page_that_loses_its_daemon_says_so(browser):
    from tests.daemon.conftest import Daemon

    daemon = Daemon("ideal", tcp=True)
    try:
        page = browser.new_page()
        page.goto(daemon.url)
        page.locator("#state", has_text="idle").wait_for()
        daemon.kill()
        page.locator("#state", has_text="connection lost").wait_for()
        page.close()
    finally:
        daemon.close()


# all figures that are ever shown of ESS and error after the end of a run, as they change
LOOKS = """
window.looks = [];
new MutationObserver(() => {
  if (!document.getElementById("job").textContent.includes("ended")) return;
  const look = ["ess", "error"].map((id) => document.getElementById(id).textContent).join(" ");
  if (window.looks.at(-1) !== look) window.looks.push(look);
}).observe(document.body, { subtree: true, childList: true, characterData: true });
"""


def test_figures_after_the_end_are_final(daemon, browser):
    page = browser.new_page(viewport={"width": 1280, "height": 900})
    page.goto(daemon.url)
    page.locator("#state", has_text="idle").wait_for()
    page.evaluate(LOOKS)
    job = daemon.acquire("final", 400)
    assert daemon.ended(job)["code"] == 0
    final = daemon.until(lambda s: s["job"]["estimate"] is not None and s["job"]["estimating"] is False)["job"]
    shown = f"{final['estimate']['ess']:.0f} {100 * final['estimate']['energy_error']:.1f} %"
    until(page, f"window.looks.at(-1) === '{shown}'")
    # before it: nothing known yet, or on its way, as the page was told; never another number
    assert [look for look in page.evaluate("looks") if look not in ("– –", "… …")] == [shown]
    page.close()


@pytest.mark.parametrize("after_a_run", [False, True])
@pytest.mark.parametrize(("width", "height"), [(320, 568), (390, 844), (768, 1024), (1280, 900), (1280, 720)])
def test_nothing_sticks_out_and_the_scale_is_in_sight(daemon, browser, width, height, after_a_run):
    """Also with a line on what became of a run, and a folder of a long name."""
    if after_a_run:
        name = f"a-name-{width}-{height}-" + "x" * 60
        daemon.ended(daemon.acquire(name, 20))
    page = browser.new_page(viewport={"width": width, "height": height})
    page.goto(daemon.url)
    page.locator("#state", has_text="idle").wait_for()
    if after_a_run:
        page.locator("#message", has_text="acquire ended").wait_for()
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    for name in ("stop", "pause", "state", "rig"):
        box = page.locator(f"#{name}").bounding_box()
        assert 0 <= box["x"] and box["x"] + box["width"] <= width, name
        assert 0 <= box["y"] and box["y"] + box["height"] <= height, name
    if width > 900:  # beside each other: all of the view is on the first screen
        box = page.locator("#scale").bounding_box()
        assert box["y"] + box["height"] <= height
    if folder := os.environ.get("GONIO_PAGES"):
        ended = "-ended" * after_a_run
        page.screenshot(path=f"{folder}/{width}x{height}{ended}.png")
    page.close()


LONG = "a_word_of_many_letters_" * 6
STATE = {
    "rig": {"name": LONG[:100], "depth": "devices", "axes": {LONG[:60]: {"lower_deg": -90, "upper_deg": 90}}},
    "state": "connection lost",
    "pose_deg": {LONG[:60]: -167.34},
    "devices": [{"name": "stage", "ok": False, "text": LONG}],
    "job": {
        "id": 7, "kind": "acquire", "material": LONG[:100], "run": f"/{LONG}/{LONG}", "truth": LONG, "ended": 1.0,
        "code": 3, "message": f"{LONG}: {LONG}", "result": {},
        "estimate": {"measured": 9, "ess": 1e9, "energy_error": 99},
        "progress": {"measured": 123456789, "budget": 987654321, "free": 123456789, "acceptance": 1.0, "rig_s": 1e7,
                     "rig_left_s": 1e7, "wall_left_s": 1e7, "per_s": 12345.6, "energy_error": None},
    },
}  # fmt: skip


@pytest.mark.parametrize(("width", "height"), [(320, 568), (390, 844), (768, 1024), (1280, 900)])
def test_words_of_any_length_stay_inside(daemon, browser, width, height):
    page = browser.new_page(viewport={"width": width, "height": height})
    page.goto(daemon.url)
    page.locator("#state", has_text="idle").wait_for()
    page.evaluate("state => { events.close(); show(state); }", STATE)
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    box = page.locator("#stop").bounding_box()
    assert 0 <= box["x"] and box["x"] + box["width"] <= width and box["y"] + box["height"] <= height
    outside = """width => [...document.querySelectorAll("body *")].filter((e) => {
      const r = e.getBoundingClientRect(); return r.width && (r.left < -0.5 || r.right > width + 0.5);
    }).map((e) => e.id || e.className || e.tagName)"""
    assert page.evaluate(outside, width) == []
    if folder := os.environ.get("GONIO_PAGES"):
        page.screenshot(path=f"{folder}/{width}x{height}-long.png", full_page=True)
    page.close()


@pytest.mark.skipif(not PICTURE, reason="makes a picture for the docs; set GONIO_SCREENSHOT to its path")
def test_picture(daemon, browser):
    page = browser.new_page(viewport={"width": 1360, "height": 900})
    page.goto(daemon.url)
    body = {"material": {"name": "chm_orange", "truth": "chm_orange", "budget": {"measurements": 200_000}}}
    job = daemon.client.post("/jobs/acquire", json=body).json()["job"]
    page.locator("#job", has_text="chm_orange").wait_for()
    until(page, f"{MEASURED} >= 1800 && lines.ess.length >= 2")
    Path(PICTURE).parent.mkdir(parents=True, exist_ok=True)
    page.screenshot(path=PICTURE, clip={"x": 0, "y": 0, "width": 1360, "height": 868})
    daemon.client.post("/stop")
    daemon.ended(job)
    page.close()
