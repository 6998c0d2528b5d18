"""`losses.csv` of a training run: a step and its losses in every row."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from data_prep.whole_files import write_whole

FILE_NAME = "losses.csv"


class LossLog:
    """Appends to `losses.csv`. Rows after `step` belong to a run that was cut off, and go."""

    def __init__(self, path: Path, step: int) -> None:
        self.path = path
        kept = _rows(path, step)
        write_whole(path, "".join(f"{line}\n" for line in kept).encode())
        self.has_header = bool(kept)

    def add(self, step: int, losses: Mapping[str, float]) -> None:
        """Write a row, and the header before the first one."""
        with self.path.open("a") as file:
            if not self.has_header:
                file.write(",".join(["step", *losses]) + "\n")
                self.has_header = True
            file.write(",".join([str(step), *(f"{v:.6g}" for v in losses.values())]) + "\n")


def read_losses(
    path: Path, last_step: int
) -> tuple[NDArray[np.int64], dict[str, NDArray[np.float64]]]:
    """Steps [N] up to `last_step`, and each loss [N] by name; empty where there is no file."""
    header, *rows = _rows(path, last_step) or ["step"]
    values = np.array([row.split(",") for row in rows], dtype=np.float64)
    values = values.reshape(-1, header.count(",") + 1)
    names = header.split(",")[1:]
    return values[:, 0].astype(np.int64), dict(zip(names, values[:, 1:].T, strict=True))


def _rows(path: Path, last_step: int) -> list[str]:
    """Header and rows up to `last_step`; nothing where there is neither file nor step."""
    lines = path.read_text().splitlines() if path.is_file() and last_step > 0 else []
    # a row that was cut short is later than the checkpoint, for rows are written before it
    whole = [line for line in lines[1:] if line.count(",") == lines[0].count(",")]
    return lines[:1] + [line for line in whole if int(line.partition(",")[0]) <= last_step]
