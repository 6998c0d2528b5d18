"""Receipts of runs, by which others verify them."""
