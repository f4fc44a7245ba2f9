"""Checks of how jobs come to the operator page and go from it, for `page_test.py`: files, the pen, deletion, tokens."""
import json
import math

from common import ROOT
from page_checks import card, fill_job
from page_daemon import BAD_JOB, SLOW_JOB


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
    (daemon.folder / "bad.json").write_text(BAD_JOB)
    page.set_input_files("#job-file", daemon.folder / "bad.json")
    checks.soon("faults of a file are listed", lambda: page.locator(".note").count() == 2, 5)
    (daemon.folder / "odd.json").write_bytes(b"\xff\xfe\x00{")
    page.set_input_files("#job-file", daemon.folder / "odd.json")
    checks.soon("a file that is no JSON is told", lambda: "1 fault" in says.inner_text(), 5)
    (daemon.folder / "large.json").write_text(" " * (1 << 20) + "{}")
    page.set_input_files("#job-file", daemon.folder / "large.json")
    checks.soon("one that is too large is not taken", lambda: "more than 1 MiB" in says.inner_text(), 5)
    checks.that("nothing is queued by any of it", len(daemon.jobs()) == before)


def check_pen(checks, page, daemon):
    page.select_option("#order-plate", "upm-2")
    page.locator("#draw summary").click()
    page.locator(".sheet-to-draw .plate").wait_for()
    marks, bad = page.locator(".mark-drawn"), page.locator(".mark-drawn.faulty")
    says = page.locator("#order-says")
    draw(page, (-60, 40), (60, 40))
    page.get_by_label("Kind of the parts").select_option("quarter")
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


def check_deletion(checks, page, daemon):
    jobs = [daemon.queue(f"turn-{number}") for number in range(4)]
    row = lambda job: page.locator(f'.rows li[data-job="{job}"]')
    for job in jobs[:3]:
        daemon.cancel(job)
    remove = row(jobs[2]).get_by_role("button", name="Delete turn-2")
    remove.wait_for()
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
    tabs = browser.new_context(has_touch=True, is_mobile=True, viewport={"width": 390, "height": 844})
    page = tabs.new_page()
    page.goto(daemon.url)
    card(page, "upm-2").wait_for()
    checks.that("no keys are shown where there are none", not page.locator("#estop-keys").is_visible())
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
