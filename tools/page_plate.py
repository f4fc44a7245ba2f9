"""Checks of what a card of the operator page shows of its job, for `page_test.py`."""
from common import config
from page_checks import card, state
from page_daemon import SLOW_JOB
from page_scripts import OVERFLOW_JS

SIZES = [(1366, 900), (768, 1024), (390, 844)]


def job(name, plate, **members):
    """A shipped job as it is sent to a plate."""
    spec = config(name)
    spec.pop("rig", None)
    spec.pop("library", None)
    return {**spec, "plate": plate, **members}


def end_all(checks, daemon, plate):
    """Leaves the plate without a job."""
    for waiting in [job for job in daemon.jobs() if job["plate"] == plate and job["state"] in ("queued", "running")]:
        daemon.cancel(waiting["id"])
    checks.soon(f"{plate} comes to rest", lambda: daemon.plate(plate)["job"] is None, 15)


def check_sights(checks, page, daemon):
    for seed in range(40):
        daemon.submit(job("sort-12", "upm-2", seed=seed + 1, planner="cor_sequence"))
    daemon.submit(job("plus-sign-endless", "upm-1"))
    page.goto(daemon.url)
    one, endless = card(page, "upm-2"), card(page, "upm-1")
    checks.soon("the job on a plate is laid out", lambda: one.locator(".bins .bin").count() > 1, 10)
    layout = daemon.get(f"/v1/jobs/{daemon.plate('upm-2')['job']}/layout")
    checks.that("a bin is drawn for every bin of the job", one.locator(".bins .bin").count() == len(layout["bins"]))
    kinds = sorted({part["kind"] for part in layout["parts"]})
    told = lambda: one.locator(".legend li").all_inner_texts()
    checks.soon("every kind is in the legend", lambda: all(any(kind in line for line in told()) for kind in kinds))
    # parts come with the first picture of the job
    looks = lambda: set(one.evaluate("""(card) => [...card.querySelectorAll('.part')].map((part) => {
        const circle = part.querySelector('circle');
        return [getComputedStyle(circle).fill, circle.getAttribute('r')].join(); })"""))
    checks.soon("kinds differ in colour and size", lambda: len(looks()) == len(kinds), 10)
    checks.soon("trails are in the colours of their parts", lambda: one.evaluate("""(card) => {
        const fills = [...card.querySelectorAll('.part circle')].map((circle) => getComputedStyle(circle).fill);
        const strokes = [...card.querySelectorAll('.trail')].map((trail) => getComputedStyle(trail).stroke);
        return strokes.length > 0 && strokes.every((stroke) => fills.includes(stroke)); }"""), 10)
    checks.soon("wanted paths are drawn", lambda: endless.locator(".paths .wanted").count() == 2, 10)
    picture = one.locator(".camera img")
    checks.soon("the camera's view is beside the plate's", lambda: picture.evaluate("(img) => img.naturalWidth") > 100, 10)
    checks.soon("and is another one soon", lambda first=picture.get_attribute("src"): picture.get_attribute("src") != first, 4)
    for width, height in SIZES:
        check_size(checks, page, width, height)
    page.set_viewport_size({"width": SIZES[0][0], "height": SIZES[0][1]})
    page.emulate_media(color_scheme="light")
    for plate in ["upm-1", "upm-2"]:
        end_all(checks, daemon, plate)
    last = one.locator(".ended")
    kept = lambda: all(text in one.inner_text() for text in ["cancelled\nsort-12", "ended ", "Last picture of sort-12"])
    for when in ["", ", after a reload, too"]:
        checks.soon(f"how and when a job ended stays on the card{when}", lambda: last.is_visible() and kept(), 5)
        checks.soon(f"with its bins and its last picture{when}", lambda: one.locator(".bins .bin").count() > 1 and picture.is_visible(), 5)
        page.reload()
    daemon.queue()
    checks.soon("until the next begins", lambda: not last.is_visible() and one.locator(".job-name", has_text="slow").count(), 10)
    end_all(checks, daemon, "upm-2")
    daemon.submit(job("ballet-8", "upm-2"))
    checks.soon("another dances", lambda: state(page, "upm-2") == "running", 10)
    one.locator(".job-name:visible").click()
    checks.soon("that it does so without a pause, is told", lambda: "a pause" in page.locator(".watched .cycle").inner_text(), 20)
    checks.soon("and its way is drawn", lambda: one.locator(".steps").get_attribute("d"))
    end_all(checks, daemon, "upm-2")


def check_size(checks, page, width, height):
    one = card(page, "upm-2")
    page.set_viewport_size({"width": width, "height": height})
    page.reload()
    for scheme in ["light", "dark"]:
        page.emulate_media(color_scheme=scheme)
        where = f"{width} px, {scheme}"
        if width != SIZES[0][0]:
            one.locator(".camera").scroll_into_view_if_needed()
        checks.soon(f"{where}: the camera's view is shown", lambda: one.locator(".camera img:not(.stale)").is_visible(), 30)
        # targets come with the first cycle
        shown = lambda: all(one.locator(what).first.is_visible() for what in [".bins .bin", ".legend li", ".part", ".target"])
        checks.soon(f"{where}: bins, kinds, parts and targets, too", shown, 10)
        over = page.evaluate(OVERFLOW_JS)
        checks.that(f"{where}: nothing overflows", over == [], over[:4] or "")
        page.evaluate("scrollTo({top: 0, behavior: 'instant'})")
        if width == SIZES[0][0]:
            boxes = [one.locator(what).bounding_box() for what in [".view", ".camera img", ".bar"]]
            within = all(box["y"] >= 0 and box["y"] + box["height"] <= height for box in boxes)
            checks.that(f"{where}: plate, camera and progress are on the first screen", within, boxes if not within else "")


def check_causes(checks, page, daemon):
    dark = {"component": "camera", "kind": "dark", "from_s": 1.0}
    passing = {**SLOW_JOB, "name": "passing", "faults": [{**dark, "to_s": 2.5}]}
    lasting = {**SLOW_JOB, "name": "lasting", "faults": [dark]}
    one = card(page, "upm-2")
    shown = one.locator(".findings li")
    daemon.submit(passing)
    checks.soon("a condition of the run is shown with what to do", lambda: shown.count() == 1, 15)
    checks.that("cause and remedy are told", all(words in one.inner_text() for words in ["no plate", "check the light"]), one.inner_text())
    checks.soon("and it goes with its cause", lambda: shown.count() == 0, 10)
    end_all(checks, daemon, "upm-2")
    daemon.submit(lasting)
    checks.soon("a guard's stop pauses the plate", lambda: state(page, "upm-2") == "paused", 30)
    pause = daemon.plate("upm-2")
    checks.that("its cause is told", pause["why"] in one.inner_text(), pause["why"])
    checks.that("what to do stands once", one.inner_text().count(pause["pause"]["remedy"]) == 1, pause["pause"]["remedy"])
    daemon.act("upm-2", "resume")
