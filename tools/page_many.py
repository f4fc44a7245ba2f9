"""Checks of the operator page with many jobs and with many tabs, for `page_test.py`."""
from page_checks import card

# Most connections that Chromium has to one host, over all its tabs.
CONNECTIONS = 6
SIGHT_JS = """(hidden) => {
  Object.defineProperty(document, 'hidden', { value: hidden, configurable: true });
  document.dispatchEvent(new Event('visibilitychange'));
}"""


def told(tab):
    """What the open job's list of events says, line by line."""
    return tab.locator(".log li").all_inner_texts()


def check_open_job(checks, page, daemon):
    daemon.reset("upm-2", "for many jobs")
    for waiting in daemon.waiting("upm-2"):
        daemon.cancel(waiting["id"])
    job = daemon.queue("early")
    daemon.act("upm-2", "resume")
    checks.soon("a job runs", lambda: daemon.plate("upm-2")["job"] == job, 10)
    for number in range(25):
        daemon.queue(f"late-{number}")
    page.reload()
    card(page, "upm-2").locator(".job-name", has_text="early").click()
    opened = page.locator(".watched", has_text="early")
    checks.soon("it opens from its card though 25 newer jobs wait", lambda: opened.locator(".log li").count() > 0)
    with page.expect_response(lambda response: "/v1/jobs?limit=20" in response.url):
        daemon.queue("later")
    checks.soon("the list goes on", lambda: page.locator(".rows .job-name", has_text="later").count() == 1)
    page.wait_for_timeout(300)
    checks.that("and the job stays open above it", opened.count() == 1 and page.locator(".rows > li").count() == 20)


def check_hidden_tab(checks, page, daemon):
    checks.soon("an open job is streamed", lambda: daemon.streams() == 1)
    page.evaluate(SIGHT_JS, True)
    checks.soon("a tab out of sight lets its stream go", lambda: daemon.streams() == 0, 8)
    page.evaluate(SIGHT_JS, False)
    checks.soon("and takes it up when it is seen again", lambda: daemon.streams() == 1, 2)
    checks.soon("what was told before is not told again", lambda: len(told(page)) == len(set(told(page))) > 0, 1)


def check_tabs(checks, page, daemon):
    tabs = [page.context.new_page() for _ in range(CONNECTIONS - 1)]
    for number, tab in enumerate(tabs):
        tab.goto(daemon.url)
        card(tab, "upm-2").locator(".job-name", has_text="early").click()
        checks.soon(f"{number + 2} tabs watch the job", lambda: daemon.streams() == number + 2)
    job = daemon.plate("upm-2")["job"]
    page.wait_for_timeout(1000)
    page.locator("#estop").click()
    report = page.locator("#stop-report")
    checks.soon("with a stream on every connection a stop is confirmed", lambda: report.locator(
        "p.done").count() == len(daemon.plates), 3)
    ended = daemon.job(job)["state"]
    for number, tab in enumerate([page, *tabs]):
        checks.soon(f"tab {number + 1} is told how the job ended, once",
                    lambda: sum(ended in line.split("\n")[-1] for line in told(tab)) == 1 and len(told(tab)) == len(set(told(tab))), 8)
    for tab in tabs:
        tab.close()


def check_long_queue(checks, page, daemon):
    daemon.reset("upm-2", "for a long queue")
    first = daemon.waiting("upm-2")[-1]
    before = daemon.plate("upm-2")["queued"]
    for number in range(190 - before):
        daemon.queue(f"many-more-{number}")
    waits = card(page, "upm-2").locator(".queue li")
    checks.soon("of a long queue the job that runs next is number 1", lambda: waits.first.get_attribute(
        "data-job") == first["id"] and waits.last.inner_text() == "and 185 behind them", 15)
