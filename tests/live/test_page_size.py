"""The files of the page `live`."""

import gzip

import pytest

pytestmark = pytest.mark.board
# A phone should load the page in seconds: 450 KB with all strips, whose tables take 40 KB.
GZIPPED_BYTES, BYTES = 410_000, 1_200_000


def test_the_page_is_small(live):
    """Fails if the page of one strip grows, for example by a library or a second runtime."""
    files = [path.read_bytes() for path in live.rglob("*") if path.is_file()]
    assert sum(map(len, files)) < BYTES
    assert sum(len(gzip.compress(data)) for data in files) < GZIPPED_BYTES
