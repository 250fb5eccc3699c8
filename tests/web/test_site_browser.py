"""The site of the documents in a real browser, opened from a folder without a server."""

import pytest
from axe_playwright_python.sync_playwright import Axe
from make import build_site
from playwright.sync_api import expect
from support.serving import until

SERIOUS = {"serious", "critical"}
VIOLATIONS = {"resultTypes": ["violations"]}  # without details of what is right
DESK, PHONE = {"width": 1280, "height": 900}, {"width": 360, "height": 800}
# The first page, and the first page of each section.
SHOWN = ["index.html"]
SHOWN += [
    f"{folder}/{next(name for name in section if name != 'title').removesuffix('.md')}.html"
    for folder, section in build_site.sections().items()
]


@pytest.fixture
def open_file(browser, site):
    """Return a function that opens a page of the site; it fails if the page asks a server."""
    contexts, asked = [], []

    def open_file(name, **options):
        contexts.append(browser.new_context(**options))
        page = contexts[-1].new_page()
        page.on("request", lambda one: asked.append(one.url))
        page.goto((site / name).as_uri())
        return page

    yield open_file
    for context in contexts:
        context.close()
    assert [url for url in asked if not url.startswith("file:")] == []
    assert asked


def serious(page, **options):
    """Return what axe finds on a page: its rules, and the first element of each."""
    found = Axe().run(page, options=VIOLATIONS | options).response["violations"]
    return [(one["id"], one["nodes"][0]["html"]) for one in found if one["impact"] in SERIOUS]


def look(page):
    return page.evaluate("document.body.dataset.mdColorScheme")


@pytest.mark.parametrize("name", SHOWN)
def test_every_reader_can_use_the_site(name, open_file):
    page = open_file(name, color_scheme="light", viewport=DESK)
    expect(page.locator("article h1")).to_be_visible()
    assert serious(page) == []
    light = look(page)
    # The other looks are of the same page, because to load it takes as long as to check it.
    page.emulate_media(color_scheme="dark")
    until(page, f"document.body.dataset.mdColorScheme !== {light!r}")
    assert serious(page, runOnly=["color-contrast"]) == []
    for viewport in (DESK, PHONE):
        page.set_viewport_size(viewport)
        width = page.evaluate("document.documentElement.scrollWidth - window.innerWidth")
        assert width <= 0, viewport  # nothing is cut at the right
    until(page, "!document.getAnimations().length")  # the menu moves out of the window
    assert serious(page) == []


@pytest.mark.parametrize("name", ["index.html", SHOWN[-1]])
def test_the_search_works_without_a_server(name, open_file):
    page = open_file(name, color_scheme="light", viewport=DESK)
    page.get_by_role("button", name="Search").first.click()
    page.keyboard.type("COBS")
    page.get_by_role("option").filter(has_text="COBS").first.click()
    expect(page.locator("article h1")).to_contain_text("protocol")
    assert "extend/protocol.html" in page.url
