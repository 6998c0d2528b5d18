"""Trainings of the networks that measure, and of the best constant image."""
