"""Vessels: smooth hulls, and what tells them apart on deck. The bow points to -Z."""
