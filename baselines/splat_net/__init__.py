"""A small network that sees the projected points: learned, but it is shown the geometry."""
