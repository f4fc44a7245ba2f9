#!/usr/bin/env python3
"""Looks at the operator page as a person would, in headless Chromium, with a daemon of its own behind it.

usage: page_test.py [--upm target/debug/upm] [--venv target/page-test] [--chromium PATH]

Prints a line for every assertion; exit status 1 when one does not hold. Playwright is installed from PyPI into the folder
`--venv` when it is not there; Chromium is the one on the PATH, or Playwright's own.
"""
import contextlib
import json
import os
import pathlib
import re
import shutil
import signal
import sys
import tempfile
import time

from common import ROOT, enter_venv, parser_of
from page_checks import Checks, card, fill_job, queue, state
from page_daemon import BAD_JOB, SLOW_JOB, PageDaemon
from page_many import check_hidden_tab, check_long_queue, check_open_job, check_tabs
from page_order import check_deletion, check_device, check_drawings, check_file, check_pen, check_ten, check_token
from page_plate import check_causes, check_sights
from page_scripts import CLEARANCE_JS, CONTRAST_JS, MARKED_JS, PLACES_JS

PACKAGES = ["playwright>=1.50,<2"]
DESK, PHONE = {"width": 1366, "height": 900}, {"width": 390, "height": 844}


def check_reach(checks, page, width):
    page.evaluate("scrollTo(0, 0)")
    height = page.evaluate("document.documentElement.scrollHeight")
    for y in [0, 60, 400, height]:
        page.evaluate(f"scrollTo({{top: {y}, behavior: 'instant'}})")
        near = page.evaluate(CLEARANCE_JS, ["#estop", 48])
        checks.that(f"{width}: nothing else to press within 48 px of the stop, scrolled by {y}", near == [], near or "")
    page.evaluate("scrollTo({top: 0, behavior: 'instant'})")


def check_first_sight(checks, page, daemon):
    page.goto(daemon.url)
    card(page, "upm-2").wait_for()
    checks.that("a card for every plate", page.locator("article.card").count() == len(daemon.plates))
    checks.soon("plates at rest are idle", lambda: state(page, "upm-2") == "idle")
    page.evaluate("document.activeElement.blur()")
    page.keyboard.press("Tab")
    checks.that("the first Tab is the stop", page.evaluate("document.activeElement.id") == "estop")
    checks.that("its key is shown beside it", "Ctrl Alt S" in page.locator("#estop-keys").inner_text())
    box = page.locator("#estop").bounding_box()
    checks.that("the stop is large", box["width"] >= 150 and box["height"] >= 60, f"{box['width']:.0f} x {box['height']:.0f}")
    check_reach(checks, page, "desk")
    for size in [{"width": 1366, "height": 768}, PHONE]:
        page.set_viewport_size(size)
        low = max(box["y"] + box["height"] for box in map(lambda what: page.locator(what).bounding_box(), ["#order-send", "#waiting"]))
        checks.that(f"{size['width']} px: new job and queue are on the first screen", low <= size["height"], f"to y = {low:.0f}")
        tall = card(page, "upm-2").bounding_box()["height"]
        checks.that(f"{size['width']} px: an idle plate is one line", tall < 90, f"{tall:.0f} px")
    page.set_viewport_size(DESK)


def check_running(checks, page, daemon):
    page.select_option("#example", "arrange-8")
    page.wait_for_function("document.querySelector('#order-plate').value === 'upm-2'")
    checks.that("an example comes with the plate of its rig", '"plate": "upm-2"' in page.input_value("#job-text"))
    # with pauses it runs as long as there is something to look at
    fill_job(page, page.input_value("#job-text").replace("{", '{"planner": "synthesized_field",', 1))
    before = len(daemon.jobs())
    page.dblclick("#order-send")
    page.locator("#order-says.good").wait_for()
    page.wait_for_timeout(500)
    checks.that("a double click queues one job", len(daemon.jobs()) == before + 1)
    one = card(page, "upm-2")
    checks.soon("its plate runs", lambda: state(page, "upm-2") == "running", 10)
    checks.soon("what happens is said aloud", lambda: "upm-2 is running" in page.locator("#spoken").inner_text())
    checks.soon("eight parts and their targets are seen", lambda: page.evaluate(PLACES_JS, "upm-2").__len__() == 8
                and one.locator(".target").count() == 8, 10)
    checks.soon("it is live", lambda: re.match(r"Live: seen 0\.\d", one.locator(".age").inner_text()))
    first = page.evaluate(PLACES_JS, "upm-2")
    moved = lambda: max(map(abs, (a - b for p, q in zip(first, page.evaluate(PLACES_JS, "upm-2")) for a, b in zip(p, q))))
    checks.soon("parts move", lambda: moved() > 1, 10)
    told, shown = daemon.plate("upm-2")["positions_mm"], page.evaluate(PLACES_JS, "upm-2")
    apart = max(abs(a - b) for p, q in zip(told, shown) for a, b in zip(p, q))
    checks.that("and are where the daemon says", apart < 15, f"{apart:.1f} mm")
    checks.that("phase and progress are told", one.locator(".phase").inner_text() != "" and
                re.fullmatch(r"\d+ %", one.locator(".share").inner_text()))
    checks.that("missed deadlines are told", "deadline" in one.locator(".facts").inner_text())
    picture = one.locator("figure")
    aged = lambda answer: {"response": answer, "headers": {**answer.headers, "upm-age-ms": "4000"}}
    page.route("**/frame.png", lambda route: route.fulfill(**aged(route.fetch())))
    checks.soon("how old a picture is, the daemon tells", lambda: re.match(r"Seen [45]\.\d", picture.inner_text()), 10)
    checks.that("and an old one is grey", picture.locator("img.stale").count() == 1)
    page.unroute_all(behavior="wait")
    one.locator(".doing .job-name").click()
    checks.soon("its events are listed", lambda: "running" in page.locator(".log").inner_text())
    row = page.locator('.row:has([aria-expanded="true"]) .state')
    checks.soon("its progress goes on in the list, too", lambda: re.fullmatch(r"running [1-9]\d* %", row.inner_text()))


def check_stale(checks, page, daemon):
    age = lambda: card(page, "upm-2").locator(".age").inner_text()
    page.evaluate("scrollTo({top: 0, behavior: 'instant'})")
    checks.soon("a plate that runs is live", lambda: age().startswith("Live"), 10)
    grey = lambda what: page.locator(what).evaluate_all("all => all.every((one) => getComputedStyle(one).filter.includes('grayscale'))")
    daemon.tell(signal.SIGSTOP)
    began = time.monotonic()
    checks.soon("a silent daemon turns every plate grey within 2.5 s", lambda: grey("article.card .view"), 2.5, busy=1)
    checks.soon("and the lists of jobs with them", lambda: grey(".rows, .queue"), 0.5, busy=1)
    checks.that("and says so", age().startswith("Not live"), age())
    checks.that("states are called unknown", state(page, "upm-2").startswith("unknown"))
    seconds = lambda: float(re.search(r"([\d.]+)\W*s ago", age())[1])
    first = seconds()
    page.wait_for_timeout(1500)
    checks.that("the age goes on", seconds() - first > 1.2 and seconds() >= time.monotonic() - began - 0.5, age())
    checks.that("the missing daemon is told beside the stop", "No news" in page.locator("#contact").inner_text())
    daemon.tell(signal.SIGCONT)
    checks.soon("it is back by itself", lambda: not page.locator("#contact.lost").count(), 6)


def check_faults(checks, page, daemon):
    before = len(daemon.jobs())
    fill_job(page, BAD_JOB)
    page.wait_for_timeout(1600)
    page.click("#order-send")
    page.locator(".note").first.wait_for()
    lines = dict(page.evaluate("[...document.querySelectorAll('.note')].map((n) => [n.querySelector('code').textContent, n.dataset.line])"))
    checks.that("each fault is listed with the line it is about", lines == {"seed": "3", "kind of part 2": "6", "colour": "8"}, lines)
    checks.that("whose number is marked", page.evaluate(MARKED_JS) == ["3", "6", "8"])
    checks.that("nothing was queued", len(daemon.jobs()) == before)
    noted = lambda: page.locator(".note").evaluate_all("notes => notes.map((note) => note.dataset.line)")
    bad = lambda old, new: BAD_JOB.replace('"seven"', "7").replace(old, new)
    for what, text, lines in [
        ("in a long text, too, which is scrolled there", bad('    {"kind": "penny"},\n', 50 * '    {"kind": "penny"},\n'), ["55", "57"]),
        ("text that is no JSON is marked where it breaks", '{\n  "name": "bad",\n  "seed": ,\n}', ["3"]),
        ("unknown keys of any letters are faults with their line", bad("colour", 'größe": 3, "//'), ["8"]),
        ("so does one within a list", bad('  "colour": 3,\n', ""), ["6"]),
    ]:
        fill_job(page, text)
        page.click("#order-send")
        checks.soon(what, lambda: sorted(set(noted())) == lines == page.evaluate(MARKED_JS))
    checks.that("which is named as a person counts", page.locator(".note code").inner_text() == "kind of part 2")


def check_queue(checks, page, daemon):
    if before := daemon.plate("upm-2")["job"]:
        daemon.cancel(before)
    fill_job(page, SLOW_JOB)
    for _ in range(3):
        queue(page)
    checks.soon("the first of three runs", lambda: daemon.plate("upm-2")["job"] not in (None, before), 10)
    waiting = card(page, "upm-2").locator(".queue li[data-job]")
    checks.soon("what waits is listed on the plate", lambda: waiting.count() == 2)
    last = waiting.last.get_attribute("data-job")
    waiting.last.get_by_role("button", name="Run slow next").click()
    checks.soon("the last can be run next", lambda: waiting.first.get_attribute("data-job") == last)
    button = waiting.last.get_by_role("button", name="Cancel slow")
    button.click()
    page.wait_for_timeout(600)
    checks.that("one press of cancel only asks", waiting.count() == 2)
    button.click()
    checks.soon("the second takes the job out of the queue", lambda: waiting.count() == 1)
    queue(page)
    first = daemon.plate("upm-2")["job"]
    button = card(page, "upm-2").locator(".actions").get_by_role("button")
    button.last.click()
    daemon.cancel(first)
    checks.soon("a press meant for one job is forgotten with it", lambda: daemon.plate("upm-2")["job"] not in (None, first)
                and button.last.is_visible() and button.last.inner_text() == "Cancel job", 10)
    running = daemon.plate("upm-2")["job"]
    button.last.click()
    page.wait_for_timeout(600)
    checks.that("so that the next job is only asked for", daemon.job(running)["state"] == "running")
    button.last.click()
    checks.soon("a running job can be cancelled", lambda: daemon.job(running)["state"] == "cancelled", 10)
    checks.soon("and the next one starts", lambda: daemon.plate("upm-2")["job"] not in (None, running), 10)
    checks.soon("history tells how it ended", lambda: page.locator(f'.rows li[data-job="{running}"] .state').inner_text() == "cancelled")
    link = page.locator(f'.rows li[data-job="{running}"] a')
    link.wait_for()
    with page.expect_download() as download:
        link.click()
    size = pathlib.Path(download.value.path()).stat().st_size
    checks.that("its recording is behind a link", size > 100, f"{size} bytes")


def check_stop(checks, page, daemon):
    failed = []
    fail = lambda route: (failed.append(1), route.abort()) if len(failed) < 6 else route.continue_()
    page.route("**/estop", fail)
    page.locator("#job-text").click()
    text = page.input_value("#job-text")
    page.keyboard.press("Control+Alt+s")
    report = page.locator("#stop-report")
    checks.soon("a stop that does not get through is said loudly", lambda: "NOT CONFIRMED" in report.inner_text(), 2, busy=1)
    confirmed = lambda: report.locator("p.done").count() == len(daemon.plates)
    checks.soon("it is tried again until every plate has confirmed it", confirmed, 8)
    checks.that("by key, from within the text, which is left as it was", page.input_value("#job-text") == text)
    page.unroute("**/estop")
    asked = []
    page.on("request", lambda request: asked.append(request.url) if request.url.endswith("/estop") else None)
    for where in ["#example", "#job-text", "#order-send", "form.reset input", ".rows .job-name"]:
        asked.clear()
        page.locator(where).first.focus()
        page.keyboard.press("Control+Alt+s")
        checks.soon(f"the key works from {where}", lambda: len(asked) == len(daemon.plates), 2)
        page.wait_for_timeout(300)
    asked.clear()
    page.evaluate("""document.querySelector('#job-text').dispatchEvent(new KeyboardEvent('keydown',
        { code: 'KeyS', key: 'ś', modifierAltGraph: true, bubbles: true, cancelable: true }))""")
    checks.soon("and where Ctrl+Alt is AltGr and makes a letter", lambda: len(asked) == len(daemon.plates), 2)
    checks.that("every plate is stopped", daemon.stopped())


def check_reset(checks, page, daemon):
    form = card(page, "upm-2").locator("form.reset")
    sent = []
    page.on("request", lambda request: sent.append(request.url) if request.url.endswith("/reset") else None)
    form.get_by_role("button").click()
    checks.that("a reset without operator and reason is not sent", sent == [] and form.locator("input:invalid").count() == 2)
    form.get_by_label("Operator").fill("Ada")
    form.get_by_role("button").click()
    checks.that("nor one without a reason", sent == [] and form.locator("input:invalid").count() == 1)
    form.get_by_label("Why it may move again").fill("The plate is clear")
    checks.soon("what is being typed stays", lambda: form.get_by_label("Operator").input_value() == "Ada", 1)
    form.get_by_role("button").click()
    checks.soon("with both the plate is paused", lambda: state(page, "upm-2") == "paused")
    page.wait_for_timeout(1000)
    checks.that("nothing starts by it", daemon.plate("upm-2")["job"] is None)
    fill_job(page, SLOW_JOB)
    queue(page)
    checks.that("nor by a new job", daemon.plate("upm-2")["state"] == "paused")
    page.evaluate("scrollTo({top: 0, behavior: 'instant'})")
    card(page, "upm-2").get_by_role("button", name="Resume").click()
    checks.soon("resume starts what waits", lambda: state(page, "upm-2") == "running", 10)
    one = card(page, "upm-2").get_by_role("button", name="Emergency stop: upm-2")
    one.click()
    checks.soon("a plate has a stop of its own", lambda: state(page, "upm-2") == "stopped")
    near = page.evaluate(CLEARANCE_JS, ['[aria-label="Emergency stop: upm-2"]', 48])
    others = [what for what in near if "estop" not in what]
    checks.that("nothing else to press within 48 px of it", others == [], others or "")


def check_restart(checks, page, daemon):
    daemon.kill()
    checks.soon("a killed daemon is missed", lambda: page.locator("#contact.lost").count(), 3)
    daemon.start()
    checks.soon("the page finds it again by itself", lambda: not page.locator("#contact.lost").count(), 8)
    checks.soon("the stop still holds", lambda: state(page, "upm-2") == "stopped")
    why = "the job store was damaged; every plate is paused"
    page.route("**/readyz", lambda route: route.fulfill(status=503, content_type="application/problem+json",
                                                        body=json.dumps({"status": 503, "detail": why})))
    checks.soon("what keeps the daemon from being ready stands on top", lambda: page.locator(
        "#banners .banner").all_inner_texts() == why.split("; "), 6)
    page.unroute("**/readyz")


def check_history(checks, page, daemon):
    daemon.reset("upm-2-evening", "for the history")
    for number in range(22):
        daemon.queue(f"many-{number}", "upm-2-evening")
    page.locator("#older:enabled").wait_for(timeout=15000)
    checks.soon("the newest job is on top", lambda: page.locator(".row .job-name").first.inner_text() == "many-21")
    first = page.locator(".rows > li").first.get_attribute("data-job")
    page.click("#older")
    checks.soon("older jobs are on the next page", lambda: page.locator("#page-of").inner_text() == "page 2")
    ids = page.locator(".rows > li").evaluate_all("(rows) => rows.map((row) => row.dataset.job)")
    checks.that("which holds others", first not in ids and len(ids) > 0, f"{len(ids)} jobs")
    page.click("#newer")
    checks.soon("and back", lambda: page.locator(".rows > li").first.get_attribute("data-job") == first)
    page.select_option("#only", "cancelled")
    checks.soon("history can be told by state", lambda: set(page.locator(".row .state").all_inner_texts()) == {"cancelled"})
    page.select_option("#only", "")


def check_looks(checks, page):
    for scheme in ["light", "dark"]:
        page.emulate_media(color_scheme=scheme)
        page.wait_for_timeout(200)
        dim = page.evaluate(CONTRAST_JS)
        checks.that(f"{scheme}: every text has a contrast of 4.5 or more", dim == [], dim[:4] or "")
    page.emulate_media(reduced_motion="reduce")
    checks.that("nothing is animated where that is not wanted", page.evaluate("document.getAnimations().length") == 0)
    page.set_viewport_size(PHONE)
    fill_job(page, BAD_JOB)
    page.wait_for_timeout(1600)
    page.click("#order-send")
    page.locator(".note").first.wait_for()
    page.locator(".rows .job-name").first.click()
    page.wait_for_timeout(300)
    wide = page.evaluate("[document.documentElement.scrollWidth, innerWidth]")
    checks.that("a phone needs no scrolling sideways", wide[0] <= wide[1], wide)
    check_reach(checks, page, "phone")
    checks.that("the stop stays in sight", page.evaluate("""() => {
        scrollTo({top: 1500, behavior: 'instant'});
        const box = document.querySelector('#estop').getBoundingClientRect();
        return box.top >= 0 && box.bottom < innerHeight; }"""))
    page.set_viewport_size(DESK)


def main():
    parser = parser_of(__doc__, venv=ROOT / "target/page-test")
    parser.add_argument("--chromium", default=shutil.which("chromium") or shutil.which("google-chrome"))
    args = parser.parse_args()
    enter_venv(args.venv, PACKAGES)
    from playwright.sync_api import sync_playwright

    with contextlib.ExitStack() as stack:
        folder = lambda: stack.enter_context(tempfile.TemporaryDirectory(prefix="page-test-"))
        chromium = stack.enter_context(sync_playwright()).chromium
        sandbox = ["--no-sandbox"] if os.geteuid() == 0 else []
        browser = stack.enter_context(contextlib.closing(chromium.launch(executable_path=args.chromium, args=sandbox)))
        tabs = browser.new_context(viewport=DESK)
        checks = Checks(page := tabs.new_page())
        errors, outside = [], []
        tabs.on("weberror", lambda error: errors.append(str(error.error)))
        tabs.on("console", lambda said: errors.append(said.text) if "Content Security Policy" in said.text else None)
        tabs.on("request", lambda asked: outside.append(asked.url) if not asked.url.startswith((daemon.url, "blob:")) else None)

        def served(**more):
            stack.callback((started := PageDaemon(args.upm, folder(), **more)).end)
            return started

        daemon = served()
        for check in [check_first_sight, check_running, check_faults, check_queue, check_stale, check_stop, check_reset,
                      check_restart, check_history]:
            check(checks, page, daemon)
        check_looks(checks, page)
        page.emulate_media(color_scheme="light", reduced_motion="no-preference")
        page.goto("about:blank")
        daemon.end()
        daemon = served()
        for check in [check_sights, check_causes, check_file, check_pen, check_drawings, check_ten, check_deletion]:
            check(checks, page, daemon)
        check_device(checks, browser, daemon)
        for check in [check_open_job, check_hidden_tab, check_tabs, check_long_queue]:
            check(checks, page, daemon)
        page.goto("about:blank")
        daemon = served(token="a-token-of-thirty-two-characters!")
        check_token(checks, page, daemon)
        checks.that("the script met no error and broke no rule of the page's policy", errors == [], errors[:3] or "")
        checks.that("nothing was asked of anybody else", outside == [], outside[:3] or "")
    print(f"{checks.count - checks.bad} of {checks.count} hold")
    sys.exit(1 if checks.bad else 0)


if __name__ == "__main__":
    main()
