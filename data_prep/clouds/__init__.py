"""Point clouds: sampling, normalisation and perturbations."""
