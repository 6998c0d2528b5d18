"""The version of the protocol: which objects, views, perturbations and scores tables are of."""

from __future__ import annotations

# Raise it when tables of two commits can no longer be compared. The sealed split is then another.
PROTOCOL_VERSION = 1
