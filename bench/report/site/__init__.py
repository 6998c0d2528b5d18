"""A static site over many runs."""
