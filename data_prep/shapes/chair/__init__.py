"""Chairs: a description is drawn first, then built. Metres."""
