"""Renderers that are not learned: surface reconstruction and its rivals, floor and ceiling."""
