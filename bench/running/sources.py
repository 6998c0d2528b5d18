"""Checksums of this project's own code."""

from __future__ import annotations

from collections.abc import Iterable
from hashlib import sha256
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SUFFIXES = (".py", ".vert", ".frag")


def code_sha256(names: Iterable[str], root: Path = ROOT) -> str:
    """Of all code in those folders and files below `root`, names included."""
    files = [
        path
        for name in names
        for path in ((root / name).rglob("*") if (root / name).is_dir() else [root / name])
        if path.suffix in SUFFIXES
    ]
    lines = (
        f"{path.relative_to(root)} {sha256(path.read_bytes()).hexdigest()}"
        for path in sorted(files)
    )
    return sha256("\n".join(lines).encode()).hexdigest()
