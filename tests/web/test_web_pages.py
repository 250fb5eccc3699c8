"""docs/extend/web-messages.md and web-requests.md: compared with the names in the code."""

from __future__ import annotations

import re

from support.documents import ROOT

from spots_web import board_feed
from spots_web.editors import KINDS

EXTEND = ROOT / "docs" / "extend"
MESSAGES = (EXTEND / "web-messages.md").read_text(encoding="utf-8")
REQUESTS = (EXTEND / "web-requests.md").read_text(encoding="utf-8")
SOURCES = [
    path.read_text(encoding="utf-8") for path in sorted((ROOT / "host/spots_web").glob("*.py"))
]


def test_each_part_of_the_messages_has_a_row():
    table = MESSAGES.partition("\n## Parts\n")[2].partition("\n## ")[0]
    named = {*re.findall(r"`([\w-]+)`", "".join(re.findall(r"^\| (.*?) \|", table, re.MULTILINE)))}
    put = {name for text in SOURCES for name in re.findall(r'\.put\("([\w-]+)"', text)}
    assert len(put) > 6  # the test finds them
    assert put - named == set()


def test_each_field_of_a_board_is_named():
    section = MESSAGES.partition("\n## board\n")[2].partition("\n## ")[0]
    named = {*re.findall(r"`(\w+)`", section)}
    assert {*board_feed._FACTS, *board_feed._FACTS_OF_STRIP} <= named


def test_each_request_has_a_row():
    rows = {*re.findall(r"`POST /(\w+)`", REQUESTS)}
    server = (ROOT / "host/spots_web/serve.py").read_text(encoding="utf-8")
    taken = {*re.findall(r'\["(\w+)"\] = [A-Z]', server)}
    assert rows == taken | {*KINDS}
