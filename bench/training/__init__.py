"""Trainings of all networks, and of the best constant image."""
