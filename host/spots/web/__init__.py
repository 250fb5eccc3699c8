"""``spots serve``: one live page for every use of the sensor. See docs/page.md."""
