"""Checks of how jobs come to the operator page and go from it, for `page_test.py`: files, the pen, deletion, tokens."""
import json
import math
import re

from common import ROOT
from page_checks import card, fill_job, state
from page_daemon import BAD_JOB, SLOW_JOB
from page_plate import end_all
from page_scripts import CLEARANCE_JS


def spot(page, x, y):
    """Where in the sheet to draw on a place of the plate is, which is given in mm."""
    sheet = page.locator(".sheet-to-draw")
    box, (left, top, width, height) = sheet.bounding_box(), map(float, sheet.get_attribute("viewBox").split())
    return {"x": (x - left) / width * box["width"], "y": (-y - top) / height * box["height"]}


def draw(page, *places):
    """Presses at places of the plate to draw on, in mm."""
    for place in places:
        page.locator(".sheet-to-draw").click(position=spot(page, *place))


def text_of(page):
    return json.loads(page.input_value("#job-text"))


def check_file(checks, page, daemon):
    page.goto(daemon.url)
    page.locator("#example option").nth(1).wait_for(state="attached")
    before = len(daemon.jobs())
    says = page.locator("#order-says")
    page.set_input_files("#job-file", ROOT / "configs/arrange-4.json")
    checks.soon("a job file is checked when it is chosen", lambda: "No fault: arrange-4" in says.inner_text(), 5)
    checks.that("its rig is left out, and that is told", "rig" not in text_of(page) and "rigs/" in says.inner_text(), says.inner_text())
    for what, content, told in [("faults of a file are listed", BAD_JOB, "3 faults"), ("a file that is no JSON is told", "ÿþ{", "1 fault"),
                                ("one that is too large is not taken", " " * (1 << 20) + "{}", "more than 1 MiB")]:
        (daemon.folder / "job.json").write_bytes(content.encode("latin-1"))
        page.set_input_files("#job-file", daemon.folder / "job.json")
        checks.soon(what, lambda: told in says.inner_text(), 5)
    checks.that("nothing is queued by any of it", len(daemon.jobs()) == before)


def check_pen(checks, page, daemon):
    page.select_option("#order-plate", "upm-2")
    page.locator("#draw summary").click()
    page.locator(".sheet-to-draw .plate").wait_for()
    marks, bad = page.locator(".mark-drawn"), page.locator(".mark-drawn.faulty")
    says = page.locator("#order-says")
    draw(page, (-60, 40), (60, 40))
    page.locator("#pen").get_by_label("Kind").select_option("quarter")
    draw(page, (0, -50))
    checks.soon("targets that are drawn are a job, which is checked", lambda: "No fault: drawn" in says.inner_text(), 5)
    job = text_of(page)
    checks.that("with a part for each, of its kind", job["parts"] == [{"kind": "penny", "count": 2}, {"kind": "quarter", "count": 1}])
    apart = max(abs(a - b) for p, q in zip(job["task"]["targets_mm"], [(-60, 40), (60, 40), (0, -50)]) for a, b in zip(p, q))
    checks.that("where they were drawn", apart <= 1, f"{apart} mm")
    draw(page, (16, -56))
    checks.soon("a target on another is marked where it is", lambda: bad.count() == 1, 5)
    fault = page.locator(".pen-faults li").all_inner_texts()
    checks.that("with what is allowed", len(fault) == 1 and fault[0].startswith("Target 4: ") and "expected" in fault[0], fault)
    draw(page, (18, -58))
    checks.soon("a press on it takes it away", lambda: marks.count() == 3 and bad.count() == 0, 5)
    sheet = page.locator(".sheet-to-draw")
    sheet.drag_to(sheet, source_position=spot(page, -60, 40), target_position=spot(page, -90, 80))
    first = lambda: text_of(page)["task"]["targets_mm"][0]
    checks.that("a target is dragged", math.dist(first(), (-90, 80)) < 2, first())
    counts = [(sheet.press(key), marks.count())[1] for key in ["Delete", "Control+z", "Control+z"]]
    checks.that("Delete takes the chosen one away, undo brings it back", counts == [2, 3, 3] and math.dist(first(), (-60, 40)) < 2, counts)
    page.get_by_role("button", name="Clear").click()
    checks.that("all goes with one press", marks.count() == 0)
    sheet.focus()
    for key in ["ArrowLeft", "ArrowLeft", "Enter"] + 9 * ["ArrowRight"] + ["Enter"]:
        page.keyboard.press(key)
    checks.soon("keys draw, too", lambda: marks.count() == 2 and "No fault" in says.inner_text(), 5)
    page.wait_for_timeout(1600)
    page.click("#order-send")
    page.locator("#order-says.good", has_text="Queued").wait_for()
    newest = daemon.jobs()[0]
    checks.that("and the job is queued when that is asked for", (newest["name"], newest["plate"]) == ("drawn", "upm-2"))


def check_drawings(checks, page, daemon):
    """Rules for places, start places, paths, and a dry run of what was drawn."""
    pen, says, told = page.locator("#pen"), page.locator("#order-says"), page.locator(".pen-faults").inner_text
    use, press = pen.locator("select").first.select_option, lambda name: page.get_by_role("button", name=name, exact=True).click()
    may_go = lambda count: f"with {count} parts" in says.inner_text()
    for shape, parts, is_so in [("letters", 14, may_go), ("ring", 8, may_go), ("grid", 12, may_go), ("grid", 60, lambda _: "expected" in told())]:
        pen.get_by_label("Or place").select_option(shape)
        pen.get_by_label("Parts").fill(str(parts))
        press("Place")
        checks.soon(f"{shape}: {parts} places by a rule, or why not", lambda: is_so(parts))
    press("Clear")
    draw(page, (-80, 90), (80, 0))
    use("start places")
    draw(page, (-90, -80))
    checks.soon("a part begins at a start place", lambda: may_go(2) and math.dist(text_of(page)["parts"][0]["position_mm"], (-90, -80)) < 2)
    draw(page, (-74, -86))
    checks.soon("two starts too near are named", lambda: "Start 2: expected" in told())
    press("Clear")
    use("paths")
    draw(page, (-110, -40), (-50, -40), (-80, 20))
    pen.get_by_label("Or place").select_option("a path in a circle")
    pen.get_by_label("Height in mm").fill("60")
    press("Place")
    checks.soon("a triangle and a circle are paths of two parts", lambda: may_go(2))
    corners, circle = (path.get("waypoints_mm") or path["circle"] for path in text_of(page)["task"]["paths"])
    checks.that("which are closed", corners[0] == corners[3] and circle["radius_mm"] == 30)
    page.locator(".sheet-to-draw").press("Control+z")
    press("Dry run")  # while the drawing's own check is still to come
    foretold = r"Dry run: can be done, 5 of 5.*; about [\d.]+ s of plate time .*; paths at up to [\d.]+ mm/s of 10.0 asked"
    checks.soon("a dry run tells verdict, time and speed", lambda: re.match(foretold, says.inner_text()), 60)
    checks.that("and queues nothing", daemon.waiting("upm-2") == [])


def check_ten(checks, page, daemon):
    """What an operator does most: each within a screen of what is seen, and three presses."""
    for size in [{"width": 1366, "height": 768}, {"width": 390, "height": 844}]:
        page.set_viewport_size(size)
        for number in range(4):
            daemon.queue(f"ten-{number}")
        checks.soon("a job runs", lambda: state(page, "upm-2") == "running", 10)
        for what, presses in TEN.items():
            page.goto(daemon.url)
            far = []
            for where in presses:
                one = page.locator(where.replace("CARD", 'article[aria-label="Plate upm-2"]')).first
                one.wait_for()
                near = page.evaluate(CLEARANCE_JS, ['[aria-label="Emergency stop: upm-2"]', 48]) if where.endswith("one") else []
                is_near = -size["height"] < (y := one.bounding_box()["y"]) < 2 * size["height"] - 44
                far += [name for name in near if "estop" not in name] + ([] if is_near else [(where, y)])
                one.fill("clear") if "input" in where else one.focus() if where in ("#example", "#job-file") else one.click()
                page.wait_for_timeout(500)
            checks.that(f"{size['width']} px: {what}: {len(presses)} presses, each within a screen", far == [] and len(presses) <= 3, far or "")
        checks.that("all of it was done", daemon.plate("upm-2")["state"] == "paused")
        end_all(checks, daemon, "upm-2")
        for plate in daemon.plates:
            daemon.reset(plate, "for the next") if plate != "upm-2" else None
            daemon.act(plate, "resume")
    page.set_viewport_size({"width": 1366, "height": 900})


TEN = {  # what is pressed or filled in
    "queue a shipped job": ["#example", "#order-send"], "make a dry run": ["#order-dry"],
    "draw a job": ["#edit > summary", "#draw > summary", ".sheet-to-draw"], "take a job file": ["#edit > summary", "#job-file"],
    "see what a job does": ["CARD .doing .job-name"], "run a job next": ["CARD .queue li:last-of-type .first"],
    "cancel a job": ["CARD .actions button:last-of-type"] * 2, "stop a plate": ["CARD .estop-one"], "stop all plates": ["#estop"],
    "reset a stop": ["CARD .reset input >> nth=0", "CARD .reset input >> nth=1", "CARD .reset button"],
}


def check_deletion(checks, page, daemon):
    jobs = [daemon.queue(f"turn-{number}") for number in range(4)]
    row = lambda job: page.locator(f'.rows li[data-job="{job}"]')
    for job in jobs[:3]:
        daemon.cancel(job)
    remove = row(jobs[2]).get_by_role("button", name="Delete turn-2")
    remove.click()
    page.wait_for_timeout(600)
    checks.that("one press of delete only asks", row(jobs[2]).count() == 1)
    remove.click()
    checks.soon("the second deletes the job", lambda: row(jobs[2]).count() == 0, 5)
    checks.that("for good", daemon.ask("GET", f"/v1/jobs/{jobs[2]}").status == 404)
    row(jobs[1]).locator(".job-name").click()
    page.evaluate("""(id) => fetch(`/v1/jobs/${id}`, { method: 'DELETE' })""", jobs[1])
    checks.soon("an open job that another client deletes leaves the list, too", lambda: row(jobs[1]).count() == 0, 8)
    checks.that("and the list does not call itself old", "may be old" not in page.locator("#jobs-say").inner_text())
    checks.soon("a job that runs cannot be deleted", lambda: daemon.plate("upm-2")["job"] == jobs[3], 15)
    checks.that("there is no such button", not row(jobs[3]).get_by_role("button", name="Delete turn-3").is_visible())
    daemon.cancel(jobs[3])


def check_device(checks, browser, daemon):
    """Keys and times on another device than this one."""
    tabs = browser.new_context(timezone_id="Asia/Kolkata")
    tabs.add_init_script("""Object.defineProperty(navigator, 'platform', { value: 'MacIntel' });
        Object.defineProperty(navigator, 'userAgentData', { value: undefined });""")
    page = tabs.new_page()
    page.goto(daemon.url)
    card(page, "upm-2").wait_for()
    checks.that("a Mac's keys are shown on a Mac", "⌘ ⌥ S" in page.locator("#estop-keys").inner_text())
    times = lambda: page.locator(".row time").all_inner_texts()
    checks.soon("times tell their zone", lambda: times() and all("GMT+5:30" in time for time in times()), 5)
    page.keyboard.press("Meta+Alt+s")
    checks.soon("and they stop", daemon.stopped, 3, busy=1)
    tabs.close()


def check_token(checks, page, daemon):
    page.goto(daemon.url)
    page.locator("#token").wait_for()
    checks.that("a daemon with a token has it asked for", page.locator("article.card").count() == 0)
    page.keyboard.press("Control+Alt+s")
    checks.soon("a stop without the token is said not to be one", lambda: "NO PLATE STOPPED" in page.locator("#stop-report").inner_text())
    page.fill("#token-text", "not-the-token")
    page.keyboard.press("Enter")
    checks.soon("a wrong one is told", lambda: "does not take" in page.locator("#token-why").inner_text())
    page.fill("#token-text", daemon.token)
    page.keyboard.press("Enter")
    checks.soon("with the right one plates are shown", lambda: page.locator("article.card").count() == len(daemon.plates))
    checks.soon("the stop pressed before gets through", daemon.stopped)
    kept = page.evaluate("[Object.values(sessionStorage).join(), Object.values(localStorage).join(), document.cookie]")
    checks.that("the token is kept in this tab alone", kept == [daemon.token, "", ""])
    page.reload()
    card(page, "upm-2").wait_for()
    checks.that("and not asked for again in it", not page.locator("#token").is_visible())
    fill_job(page, SLOW_JOB)
    page.click("#order-send")
    says = page.locator("#order-says.bad, #order-says.good")
    says.wait_for()
    checks.that("requests carry it", "token" not in says.inner_text(), says.inner_text())
