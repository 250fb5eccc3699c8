"""`traceback` of the virtual board."""

import io
import sys


def format_exception(exc, value=None, tb=None, limit=None, chain=True):
    text = io.StringIO()
    sys.print_exception(exc, text)
    return [line + "\n" for line in text.getvalue().rstrip("\n").split("\n")]
