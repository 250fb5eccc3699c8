"""Measures simulated strips for documents and tests; run with ``PYTHONPATH=tools``."""
