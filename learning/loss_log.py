"""The losses of a training run as `losses.csv`, a step in every row."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from data_prep.files.atomic_write import write_whole

FILE_NAME = "losses.csv"


class LossLog:
    """A writer that appends rows to `losses.csv`.

    path  of the file
    step  of the checkpoint that training continues from. Rows of later steps are dropped: they were
          written before the training was interrupted, and these steps are taken again
    """

    def __init__(self, path: Path, step: int) -> None:
        self.path = path
        kept = _rows(path, step)
        write_whole(path, "".join(f"{line}\n" for line in kept).encode())
        self.has_header = bool(kept)

    def add(self, step: int, losses: Mapping[str, float]) -> None:
        """Write the losses of a step as a row, and before the first row the header."""
        numbers = [f"{value:.6g}" for value in losses.values()]
        with self.path.open("a") as file:
            if not self.has_header:
                file.write(",".join(["step", *losses]) + "\n")
                self.has_header = True
            file.write(",".join([str(step), *numbers]) + "\n")


def _rows(path: Path, last_step: int) -> list[str]:
    """Return the header and rows up to `last_step`; nothing without file or step."""
    lines = path.read_text().splitlines() if path.is_file() and last_step > 0 else []
    # a row that was cut short is later than the checkpoint, for rows are written before it
    whole = [line for line in lines[1:] if line.count(",") == lines[0].count(",")]
    return lines[:1] + [line for line in whole if int(line.partition(",")[0]) <= last_step]
