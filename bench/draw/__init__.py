"""A user's own cloud: drawn by a method, or reduced to the points that make a method fail."""
