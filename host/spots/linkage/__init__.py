"""Strips as joint encoders, and a five-bar linkage with its digital twin (``spots twin``)."""
