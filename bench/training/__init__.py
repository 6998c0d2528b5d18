"""Trainings of the networks that draw."""
