"""A browser without a screen and without a network, for pages."""

import shutil

import pytest
from oracles import LONGEST

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
SOFTWARE = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist", "--no-sandbox"]


@pytest.fixture(scope="session")
def browser():
    """Chromium, where the system has it."""
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    if CHROMIUM is None:
        pytest.skip("the system has no Chromium, Debian's package chromium")
    with playwright.sync_playwright() as started:
        browser = started.chromium.launch(executable_path=CHROMIUM, args=SOFTWARE)
        yield browser
        browser.close()


@pytest.fixture
def opened(browser):
    """Function that opens a file; returns its page, and a list that gets its errors and what it asks other sites."""
    contexts = []

    def open_page(path, width=900, height=700, ready="window.ready === true"):
        context = browser.new_context(viewport={"width": width, "height": height}, offline=True)
        contexts.append(context)
        page, faults = context.new_page(), []
        page.on("console", lambda message: faults.append(message.text) if message.type == "error" else None)
        page.on("pageerror", lambda error: faults.append(str(error)))
        local = ("file:", "data:", "blob:", "about:")
        page.on("request", lambda request: None if request.url.startswith(local) else faults.append(request.url))
        page.goto(path.as_uri())
        page.set_default_timeout(1000 * LONGEST)
        page.wait_for_function(ready)
        return page, faults

    yield open_page
    for context in contexts:
        context.close()
