"""``spots serve``: the web UI, a live view of a board and its applications. See docs/try/web.md."""
