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


def number(page, name):
    return int("0" + "".join(c for c in page.locator(f"#{name}").text_content() if c.isdigit()))


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
    while "runs/page" not in page.locator("#run").text_content() or number(page, "measured") < 60:
        page.wait_for_timeout(50)
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


@pytest.mark.parametrize(("width", "height"), [(390, 844), (768, 1024), (1280, 900), (1280, 720)])
def test_nothing_sticks_out_and_the_scale_is_in_sight(daemon, browser, width, height):
    page = browser.new_page(viewport={"width": width, "height": height})
    page.goto(daemon.url)
    page.locator("#state", has_text="idle").wait_for()
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    for name in ("stop", "pause", "state", "rig"):
        box = page.locator(f"#{name}").bounding_box()
        assert 0 <= box["x"] and box["x"] + box["width"] <= width, name
        assert 0 <= box["y"] and box["y"] + box["height"] <= height, name
    if width > 900:  # beside each other: all of the view is on the first screen
        box = page.locator("#scale").bounding_box()
        assert box["y"] + box["height"] <= height
    if folder := os.environ.get("GONIO_PAGES"):
        page.screenshot(path=f"{folder}/{width}.png")
    page.close()


@pytest.mark.skipif(not PICTURE, reason="makes a picture for the docs; set GONIO_SCREENSHOT to its path")
def test_picture(daemon, browser):
    page = browser.new_page(viewport={"width": 1360, "height": 900})
    page.goto(daemon.url)
    body = {"material": {"name": "chm_orange", "truth": "chm_orange", "budget": {"measurements": 5000}}}
    job = daemon.client.post("/jobs/acquire", json=body).json()["job"]
    page.locator("#job", has_text="chm_orange").wait_for()
    while number(page, "measured") < 1800 or page.locator("#ess").text_content() == "–":
        page.wait_for_timeout(50)
    Path(PICTURE).parent.mkdir(parents=True, exist_ok=True)
    page.screenshot(path=PICTURE, clip={"x": 0, "y": 0, "width": 1360, "height": 882})
    daemon.client.post("/stop")
    daemon.ended(job)
    page.close()
