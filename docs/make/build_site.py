"""Builds the documents as a site of static files, without a network.

The pages are those of docs/, and documents of the repository's root: README.md becomes the first
page. A link to a file that is no page becomes its text, because the site has no such file.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

from spots.common import toml
from spots.common.python import module_command

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
_FILES = Path(__file__).parent / "site_files"
_NAV = DOCS / "make" / "nav.toml"
# Files of the root that are pages, and the folders of their pages.
_ROOT_PAGES = {
    "README.md": "index.md",
    "ARCHITECTURE.md": "extend/ARCHITECTURE.md",
    "CONTRIBUTING.md": "extend/CONTRIBUTING.md",
    "SECURITY.md": "operate/SECURITY.md",
    "CHANGELOG.md": "evidence/CHANGELOG.md",
}
# A link with its text, or a picture. A text may contain a picture, but no other link.
_LINK = re.compile(r"(!?)\[((?:[^\[\]]|!?\[[^\[\]]*\])*)\]\(([^)\s]+)\)")
_CODE = re.compile(r"^ *(```|~~~).*?^ *\1 *$|`[^`\n]*`", re.MULTILINE | re.DOTALL)
_COLOUR = re.compile(r"\x1b\[[0-9;]*m")
# The search needs this script if the site is opened from a folder. The theme links to a copy on
# another host.
_WORKER = re.compile(r"https://unpkg\.com/iframe-worker/shim")


def sections() -> dict[str, dict[str, str]]:
    """Return the sections of nav.toml: by folder, a dict of `title`, and of kinds by page."""
    return toml.loads(_NAV.read_text(encoding="utf-8"))


def pages() -> dict[str, str]:
    """Return the kind of each page by its path in the site, without the first page."""
    return {
        f"{folder}/{name}": kind
        for folder, section in sections().items()
        for name, kind in section.items()
        if name != "title"
    }


def source(page: str) -> Path:
    """Return the file in the repository from which a page of the site is made."""
    of_root = {in_site: name for name, in_site in _ROOT_PAGES.items()}
    return ROOT / of_root[page] if page in of_root else DOCS / page


def _relinked(text: str, page: str) -> str:
    """Return a page's text with its links as they are in the site."""
    folder = source(page).parent

    def link(match: re.Match) -> str:
        mark, label, to = match.groups()
        path, _, anchor = to.partition("#")
        label = _LINK.sub(link, label)
        if not path or re.match(r"[a-z]+:", path):
            return f"{mark}[{label}]({to})"
        target = (folder / path).resolve().relative_to(ROOT).as_posix()
        if target in _ROOT_PAGES:
            target = _ROOT_PAGES[target]
        elif target.startswith("docs/"):
            target = target.removeprefix("docs/")
        else:
            return label
        to = os.path.relpath(target, Path(page).parent).replace(os.sep, "/")
        return f"{mark}[{label}]({to}{'#' + anchor if anchor else ''})"

    kept = []
    end = 0
    for code in _CODE.finditer(text):
        kept += [_LINK.sub(link, text[end : code.start()]), code[0]]
        end = code.end()
    return "".join([*kept, _LINK.sub(link, text[end:])])


def stage(folder: Path) -> None:
    """Write the pages, their pictures and the configuration of the site into a new folder."""
    shutil.rmtree(folder, ignore_errors=True)
    target = folder / "pages"
    shutil.copytree(DOCS / "pictures", target / "pictures")
    for page in ("index.md", *pages()):
        path = target / page
        path.parent.mkdir(parents=True, exist_ok=True)
        text = _relinked(source(page).read_text(encoding="utf-8"), page)
        path.write_text(text, encoding="utf-8")
    for table in DOCS.glob("*/*.csv"):
        (target / table.parent.name).mkdir(exist_ok=True)
        shutil.copy(table, target / table.parent.name)
    for name in ("site.css", "site.js", "iframe-worker.js"):
        shutil.copy(_FILES / name, target)
    nav = [{"SPOTS": "index.md"}]
    for name, section in sections().items():
        nav.append({section["title"]: [f"{name}/{one}" for one in section if one != "title"]})
    configuration = (_FILES / "site.yml").read_text(encoding="utf-8")
    (folder / "mkdocs.yml").write_text(f"{configuration}nav: {json.dumps(nav)}\n", encoding="utf-8")


def build(folder: Path) -> Path:
    """Build the site into `site` of a folder, and return the path of its first page.

    Raises
    ------
    SystemExit
        If a link leads nowhere, or the builder has another warning.
    """
    stage(folder / "docs")
    run = subprocess.run(
        module_command("zensical", "build", "--clean", "--strict"),
        cwd=folder / "docs",
        env=os.environ | {"NO_COLOR": "1"},
        capture_output=True,
        text=True,
    )
    if run.returncode:
        said = _COLOUR.sub("", run.stdout + run.stderr).partition("Traceback")[0]
        sys.exit(f"the site cannot be built:\n{said}")
    site = folder / "site"
    shutil.rmtree(site, ignore_errors=True)
    shutil.move(folder / "docs" / "site", site)
    for path in site.rglob("*.html"):
        text = path.read_text(encoding="utf-8")
        up = "../" * (len(path.relative_to(site).parts) - 1)
        path.write_text(_WORKER.sub(f"{up}iframe-worker.js", text), encoding="utf-8")
    return site / "index.html"


if __name__ == "__main__":
    print(build(ROOT / "build"))
