"""Random generators named by their purpose, so that the order of the work does not matter."""

from __future__ import annotations

import hashlib
import json

import numpy as np


def generator(*key: str | int) -> np.random.Generator:
    """Return a generator that depends on `key` alone: same key, same stream, on every machine.

    Different keys give independent streams (the seed is the key's sha256). Types count: 1 and "1"
    are different keys.
    """
    digest = hashlib.sha256(json.dumps(key).encode()).digest()
    return np.random.default_rng(int.from_bytes(digest, "big"))
