"""The studio's page in Chromium, as a person has it before them; shared by the tests of the page."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path

from playwright.sync_api import Browser, Page, sync_playwright

from tests.studio_server import Studio

CHROMIUM = Path("/usr/bin/chromium")
SOON = 60_000  # ms: the machine is shared
FIRST = 300_000  # ms: of the first page in a new checkout, whose kernels are compiled before there is a picture


@contextlib.contextmanager
def chromium() -> Iterator[Browser]:
    """The system's Chromium, without a window."""
    with sync_playwright() as playwright:
        one = playwright.chromium.launch(executable_path=str(CHROMIUM), args=["--no-sandbox", "--enable-unsafe-swiftshader"])
        yield one
        one.close()


@contextlib.contextmanager
def opened(browser: Browser, studio: Studio, state: str = "") -> Iterator[Page]:
    """A page that has shown its first picture; nothing may have gone wrong in it, and nothing been asked for elsewhere."""
    context = browser.new_context(viewport={"width": 1280, "height": 800}, accept_downloads=True)
    one = context.new_page()
    wrong: list[str] = []
    one.on("pageerror", lambda error: wrong.append(str(error)))
    one.on("request", lambda request: wrong.append(request.url) if not request.url.startswith(
        (studio.address, "blob:", "data:")) else None)
    one.goto(f"{studio.address}{state}")
    revision_after(one, 0, FIRST)
    yield one
    context.close()
    assert not wrong


def revision(page: Page) -> int:
    return int(page.get_by_test_id("driver-view").get_attribute("data-revision") or 0)


def revision_after(page: Page, before: int, within_ms: int = SOON) -> int:
    page.wait_for_function("before => Number(document.querySelector('[data-testid=driver-view]').dataset.revision) > before",
                           arg=before, timeout=within_ms)
    return revision(page)


def figure(page: Page, name: str) -> float:
    return float(page.get_by_test_id(name).get_attribute("data-value") or "nan")


def settled(page: Page) -> None:
    """The fine picture of the design there is now is on the screen, or it was refused; nothing more is due."""
    page.wait_for_function("document.body.dataset.due === 'no'", timeout=SOON)


def address_comes_to(page: Page, text: str, hold: bool = True) -> None:
    """The page's address comes to hold a text, or to hold it no more: it is written once a change has rested."""
    page.wait_for_function("([text, hold]) => location.hash.includes(text) === hold", arg=[text, hold], timeout=SOON)


def becomes(page: Page, name: str, value: float) -> None:
    """The control of a key comes to show a value."""
    page.wait_for_function("([name, value]) => document.querySelector(`input[name=\"${name}\"]`)?.valueAsNumber === value",
                           arg=[name, value], timeout=SOON)


def key(page: Page, name: str) -> float:
    return float(page.locator(f'input[name="{name}"]').input_value())
