"""What there is to render: shapes, clouds, views, true pictures, datasets, perturbations."""
