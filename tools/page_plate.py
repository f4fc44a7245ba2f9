"""Checks of what a card of the operator page shows of its job, for `page_test.py`."""
import json

from page_checks import card, state
from page_daemon import ROOT, SLOW_JOB
from page_scripts import OVERFLOW_JS

SIZES = [(1366, 900), (768, 1024), (390, 844)]
# Times that are known: at plate time's own pace and at half of it, after a start without progress, for parts that settle,
# and where nothing is known yet.
LEFT_JS = """async () => {
  const { TimeLeft, about } = await import('/assets/left.js');
  const after = (looks, settles) => {
    const left = new TimeLeft();
    const last = looks.map(([look, now]) => left.take(look, now, settles)).at(-1);
    return last === null ? null : Math.round(last * 10) / 10;
  };
  const look = (at_s, progress, job = 'a') => ({ job, at_s, progress });
  return [
    after([[look(8, 0.2), 100], [look(10, 0.25), 102]]),
    after([[look(8, 0.2), 100], [look(10, 0.25), 104]]),
    after([[look(8, 0), 100], [look(12, 0.1), 104]]),
    after([[look(8, 0.4), 100], [look(10, 0.5), 102]], true),
    after([[look(8, 0.99), 100], [look(10, 0.999), 102]], true),
    after([[look(8, 0), 100], [look(10, 0), 102]]),
    after([[look(10, 0.25), 100]]),
    after([[look(8, 0.2, 'b'), 100], [look(10, 0.25), 102]]),
    after([[look(10, 0.25), 100], [look(10, 0.25), 102]]),
    after([[look(8, 0.9), 100], [look(10, 1), 102]]),
    about(null), about(3), about(34), about(89), about(95), about(7200)];
}"""

def job(name, plate, **members):
    """A shipped job as it is sent to a plate."""
    spec = json.loads((ROOT / f"configs/{name}.json").read_text())
    spec.pop("rig", None)
    spec.pop("library", None)
    return {**spec, "plate": plate, **members}


def end_all(checks, daemon, plate):
    """Leaves the plate without a job."""
    for waiting in [job for job in daemon.jobs() if job["plate"] == plate and job["state"] in ("queued", "running")]:
        daemon.ask(f"/v1/jobs/{waiting['id']}/cancel", {})
    checks.soon(f"{plate} comes to rest", lambda: daemon.plate(plate)["job"] is None, 15)


def check_estimates(checks, page, daemon):
    page.goto(daemon.url)
    card(page, "upm-2").wait_for()
    found = page.evaluate(LEFT_JS)
    wanted = [30, 60, 36, 66.4, 0, None, None, None, None, None, "", "about 10\u00a0s left", "about 30\u00a0s left", "about 90\u00a0s left",
              "about 2\u00a0min left", "about 2\u00a0h left"]
    checks.that("time left is what progress over plate time says, and unknown where that says nothing", found == wanted, found)


def check_sights(checks, page, daemon):
    for seed in range(40):
        daemon.ask("/v1/jobs", job("sort-12", "upm-2", seed=seed + 1))
    daemon.ask("/v1/jobs", job("plus-sign-endless", "upm-1"))
    page.goto(daemon.url)
    one, endless = card(page, "upm-2"), card(page, "upm-1")
    checks.soon("the job on a plate is laid out", lambda: one.locator(".bins .bin").count() > 1, 10)
    layout = daemon.ask(f"/v1/jobs/{daemon.plate('upm-2')['job']}/layout")
    checks.that("a bin is drawn for every bin of the job", one.locator(".bins .bin").count() == len(layout["bins"]))
    kinds = sorted({part["kind"] for part in layout["parts"]})
    told = one.locator(".legend li").all_inner_texts()
    checks.that("every kind is in the legend", all(any(kind in line for line in told) for kind in kinds), told)
    looks = one.evaluate("""(card) => [...card.querySelectorAll('.part')].map((part) => {
        const circle = part.querySelector('circle');
        return [getComputedStyle(circle).fill, circle.getAttribute('r')].join(); })""")
    checks.that("kinds differ in colour and size", len(set(looks)) == len(kinds), sorted(set(looks)))
    checks.soon("trails are in the colours of their parts", lambda: one.evaluate("""(card) => {
        const fills = [...card.querySelectorAll('.part circle')].map((circle) => getComputedStyle(circle).fill);
        const strokes = [...card.querySelectorAll('.trail')].map((trail) => getComputedStyle(trail).stroke);
        return strokes.length > 0 && strokes.every((stroke) => fills.includes(stroke)); }"""), 10)
    checks.soon("wanted paths are drawn", lambda: endless.locator(".paths .wanted").count() == 2, 10)
    picture = one.locator(".camera img")
    checks.soon("the camera's view is beside the plate's", lambda: picture.evaluate("(img) => img.naturalWidth") > 100, 10)
    first = picture.get_attribute("src")
    checks.soon("and is another one soon", lambda: picture.get_attribute("src") != first, 4)
    for width, height in SIZES:
        check_size(checks, page, width, height, endless)
    page.set_viewport_size({"width": SIZES[0][0], "height": SIZES[0][1]})
    page.emulate_media(color_scheme="light")
    for plate in ["upm-1", "upm-2"]:
        end_all(checks, daemon, plate)
    checks.soon("without a job there is no picture", lambda: not picture.is_visible(), 3)


def check_size(checks, page, width, height, endless):
    one = card(page, "upm-2")
    page.set_viewport_size({"width": width, "height": height})
    page.reload()
    for scheme in ["light", "dark"]:
        page.emulate_media(color_scheme=scheme)
        where = f"{width} px, {scheme}"
        left = one.locator(".left")
        checks.soon(f"{where}: time left is told", lambda: left.is_visible() and left.inner_text().startswith("about "), 30)
        if width != SIZES[0][0]:
            one.locator(".camera").scroll_into_view_if_needed()
        checks.soon(f"{where}: so is the camera's view", lambda: one.locator(".camera img:not(.stale)").is_visible(), 5)
        seen = {what: one.locator(what).first.is_visible() for what in [".bins .bin", ".legend circle", ".part", ".target"]}
        checks.that(f"{where}: bins, kinds, parts and targets, too", all(seen.values()), seen)
        checks.that(f"{where}: nothing is told of a job without end", endless.locator(".left").inner_text() == "")
        over = page.evaluate(OVERFLOW_JS)
        checks.that(f"{where}: nothing overflows", over == [], over[:4] or "")
        page.evaluate("scrollTo({top: 0, behavior: 'instant'})")
        if width == SIZES[0][0]:
            boxes = [one.locator(what).bounding_box() for what in [".view", ".camera img", ".bar"]]
            within = all(box["y"] >= 0 and box["y"] + box["height"] <= height for box in boxes)
            checks.that(f"{where}: plate, camera and time left are on the first screen", within, boxes if not within else "")
            beside = boxes[1]["x"] >= boxes[0]["x"] + boxes[0]["width"]
            checks.that(f"{where}: plate and camera are side by side", beside)


def check_causes(checks, page, daemon):
    dark = {"component": "camera", "kind": "dark", "from_s": 1.0}
    passing = {**SLOW_JOB, "name": "passing", "faults": [{**dark, "to_s": 2.5}]}
    lasting = {**SLOW_JOB, "name": "lasting", "faults": [dark]}
    one = card(page, "upm-2")
    shown = one.locator(".conditions li")
    told = []
    page.on("response", lambda answer: told.append(answer) if answer.url.endswith("/v1/plates") else None)
    daemon.ask("/v1/jobs", passing)
    checks.soon("a condition of the run is shown with what to do", lambda: shown.count() == 1, 15)
    text = shown.first.inner_text() if shown.count() else ""
    checks.that("cause and remedy are told", "no plate" in text and "check the light" in text, text)
    checks.soon("and it goes with its cause", lambda: shown.count() == 0, 10)
    end_all(checks, daemon, "upm-2")
    daemon.ask("/v1/jobs", lasting)
    checks.soon("a guard's stop pauses the plate", lambda: state(page, "upm-2") == "paused", 30)
    pause = daemon.plate("upm-2")
    said = one.inner_text()
    checks.that("its cause is told", pause["why"] in said, pause["why"])
    checks.that("what to do stands once", said.count(pause["pause"]["remedy"]) == 1, pause["pause"]["remedy"])
    daemon.ask("/v1/plates/upm-2/resume", {})
    checks.soon("the plate goes on when it is resumed", lambda: state(page, "upm-2") == "idle", 5)
