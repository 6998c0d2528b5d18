"""Suites with a procedure of their own."""
