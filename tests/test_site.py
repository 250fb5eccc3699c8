"""The site of the documents: its build, its links, and the lengths of its pages.

tests/web/test_site_browser.py opens it in a browser.
"""

from __future__ import annotations

import re

import pytest
from make import build_site
from support.site import Html, prose, words

import spots.errors
import spots_linkage
import spots_sim
from spots.errors import SpotsError

KINDS = {"tutorial", "how-to", "reference", "explanation", "evidence"}
PAGES = build_site.pages()
HOW_TO_MAX = 1000
PARAGRAPH_MAX = 80
CELL_MAX = 25
LIVE = "live/index.html"  # `make docs` copies this page to the site; tests/live opens it
GENERATED = re.compile(r"^::: (\S+)$", re.MULTILINE)
FOREIGN = re.compile(r"(https?:)?//")


@pytest.fixture(scope="module")
def built(site):
    """The pages of the site by their path, as `Html`."""
    return {path.relative_to(site).as_posix(): Html(path) for path in site.rglob("*.html")}


def html_name(page):
    return page.removesuffix(".md") + ".html"


def generated(page):
    """Return the names in Python whose docstrings a page shows in the site."""
    return GENERATED.findall(build_site.source(page).read_text(encoding="utf-8"))


def test_each_page_is_in_the_navigation_one_time():
    docs = build_site.DOCS
    of_docs = {path.relative_to(docs).as_posix() for path in docs.rglob("*.md")}
    assert {page for page in PAGES if build_site.source(page) == docs / page} == of_docs
    assert {*PAGES.values()} <= KINDS


@pytest.mark.board
def test_each_page_is_built(built):
    assert {html_name(page) for page in (*PAGES, "index.md")} == {*built} - {"404.html"}


def test_each_exported_name_is_on_one_page_of_the_reference():
    named = sorted(name for page in PAGES for name in generated(page))
    assert named == sorted({*named})
    packages = spots, spots_sim, spots_linkage
    exported = {f"{one.__name__}.{name}" for one in packages for name in one.__all__}
    found = vars(spots.errors).values()
    errors = {one for one in found if isinstance(one, type) and issubclass(one, SpotsError)}
    exported |= {f"spots.errors.{one.__name__}" for one in errors - {SpotsError}}
    assert exported <= {*named}


@pytest.mark.board
@pytest.mark.parametrize("page", [page for page in PAGES if generated(page)])
def test_a_page_of_the_reference_names_what_the_site_adds(page, built):
    text = build_site.source(page).read_text(encoding="utf-8")
    for name in generated(page):
        before = text.partition(f"::: {name}\n")[0]
        assert re.search(rf"`(\w+\.)*{name.rpartition('.')[2]}(\(.*?\))?`", before), name
        assert name in built[html_name(page)].ids


@pytest.mark.board
def test_links_lead_to_files_and_headings_of_the_site(site, built):
    broken = []
    for name, page in built.items():
        for link in (*page.links, *page.loaded):
            path, _, anchor = link.partition("#")
            if re.match("[a-z]+:", link) or name == "404.html":
                continue
            target = (site / name).parent / path if path else site / name
            to = target.resolve().relative_to(site.resolve()).as_posix()
            if to == LIVE:
                continue
            if not target.is_file() or (anchor and to in built and anchor not in built[to].ids):
                broken.append((name, link))
    assert broken == []
    assert len(built["index.html"].links) > 10  # the test finds links


@pytest.mark.board
def test_no_page_loads_anything_from_another_host(site, built):
    loaded = {link for page in built.values() for link in page.loaded}
    assert [link for link in loaded if FOREIGN.match(link)] == []
    assert any(link.endswith(".css") for link in loaded)
    for path in site.rglob("*.css"):
        text = path.read_text(encoding="utf-8")
        assert not re.search(r"@import|url\(['\"]?(https?:)?//", text), path.name


@pytest.mark.board
def test_a_broken_link_stops_the_build(tmp_path, monkeypatch):
    monkeypatch.setattr(build_site, "pages", dict)
    monkeypatch.setattr(build_site, "sections", dict)
    monkeypatch.setattr(build_site, "ROOT", tmp_path)
    readme = tmp_path / "README.md"
    readme.write_text("# A\n\n[here](#a)\n")
    build_site.build(tmp_path)
    for link in ("#b", "docs/b.md"):
        readme.write_text(f"# A\n\n[there]({link})\n")
        with pytest.raises(SystemExit, match="cannot be built"):
            build_site.build(tmp_path)


@pytest.mark.board
@pytest.mark.parametrize("page", ["index.md", *PAGES])
def test_the_site_shows_what_github_shows(page, built):
    # A list without a blank line before it, or with less than four spaces, is none in the site.
    shown = prose(build_site.source(page).read_text(encoding="utf-8"))
    counts = built[html_name(page)].counts
    if not generated(page):
        assert counts == shown.counts
    assert all(counts[name] >= shown.counts[name] for name in counts)


@pytest.mark.parametrize("page", PAGES)
def test_no_paragraph_and_no_cell_is_too_long(page):
    shown = prose(build_site.source(page).read_text(encoding="utf-8"))
    assert [one for one in shown.paragraphs if words(one) > PARAGRAPH_MAX] == []
    assert [one for one in shown.cells if words(one) > CELL_MAX] == []


@pytest.mark.parametrize("page", [page for page, kind in PAGES.items() if kind == "how-to"])
def test_a_how_to_page_is_short(page):
    shown = prose(build_site.source(page).read_text(encoding="utf-8"))
    assert sum(map(words, (*shown.paragraphs, *shown.cells))) <= HOW_TO_MAX
