"""Checks of the operator page of a daemon that asks for a token, for `page_test.py`."""
from page_checks import card, fill_job
from page_daemon import SLOW_JOB


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
