"""Designs a real strip: length, dye, moulds, drawings and recipe."""
