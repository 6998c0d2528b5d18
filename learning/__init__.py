"""Mechanisms of all trainings: the loop, checkpoints, logs, several processes, weights as files."""
