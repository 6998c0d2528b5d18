"""Input of the benchmark: shapes, clouds, views, true images, datasets, perturbations."""
