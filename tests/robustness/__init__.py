"""Tests of the system under damaged files, faulty methods and kills, and their commands.

A package, so that spawned workers and `python -m tests.robustness.NAME` import its modules by name.
"""
