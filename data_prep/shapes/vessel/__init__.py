"""Vessels: smooth hulls, and what distinguishes them on deck. The bow points to -Z."""
