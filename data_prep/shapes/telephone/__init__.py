"""Telephones: thin slabs that stand upright, and boxes with a handset. They look to -Z."""
