"""What the checks of `page_test.py` have in common: how they count, and what a person does with the page."""
import json
import time


# a machine that also builds or tests takes longer than an idle one
BUSY = 4.0


class Checks:
    def __init__(self, page):
        self.page, self.bad, self.count = page, 0, 0

    def that(self, what, holds, found=""):
        self.count += 1
        self.bad += not holds
        print(f"{'ok  ' if holds else 'FAIL'} {what}{f' ({found})' if found != '' else ''}", flush=True)

    def soon(self, what, ask, within_s=5.0, busy=BUSY):
        """Asks until the answer is true, a busy machine `busy` times as long as `within_s`; says how long that took."""
        began = time.monotonic()
        while not (holds := bool(ask())) and time.monotonic() - began < busy * within_s:
            self.page.wait_for_timeout(50)
        self.that(what, holds, f"{time.monotonic() - began:.2f} s")
        return holds


def card(page, plate):
    return page.locator(f'article[aria-label="Plate {plate}"]')


def state(page, plate):
    return card(page, plate).locator(".card-title .state").inner_text()


def fill_job(page, text):
    page.evaluate("document.querySelector('#edit').open = true")
    page.locator("#job-text").fill(text if isinstance(text, str) else json.dumps(text, indent=1))


def queue(page):
    """Queues what stands in the form and waits until it is said to be."""
    page.wait_for_timeout(1600)
    page.click("#order-send")
    page.locator("#order-says.good").wait_for()
