"""The procedural set: thirteen classes of parametric shapes, nothing to download."""
