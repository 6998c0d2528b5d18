"""Sharpness of edges and lightness of the images of a run, against its true images.

    python -m studies.sharpness DIR [-o sharpness.csv]

Sharpness is the mean gradient of the steepest 2 % of an image's pixels over that of the true image:
1 is as sharp as the truth, less is blurred. It does not ask whether edges are in their place, which
the metrics do. Lightness is the mean luma (Rec. 601, 0..1) of the pixels that both images show as
object, drawn less true; objects are told apart by the mean luma of their true images.

Values are means over the objects of a run, each of which is the mean over its views.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bench.commands.score import kept_images
from bench.records.artifacts import JobName
from bench.records.record import GROUND_TRUTH
from bench.records.stored_artifacts import StoredArtifacts
from bench.report.stored import Sources
from data_prep.files.atomic_write import write_whole
from data_prep.scene import UInt8Images
from studies.tables import markdown

STEEPEST = 0.02
LUMA = np.array([0.299, 0.587, 0.114]) / 255
WHITE = 250 / 255
DARK, LIGHT = 0.35, 0.75


def sharpness(images: UInt8Images) -> NDArray[np.float64]:
    """Return the mean gradient [V] of the steepest pixels of images [V, H, W, 3], per pixel."""
    down, across = np.gradient(images @ LUMA, axis=(1, 2))
    gradients = np.hypot(down, across).reshape(len(images), -1)
    return np.sort(gradients, axis=1)[:, -round(STEEPEST * gradients.shape[1]) :].mean(axis=1)


def lightness(truth: UInt8Images, drawn: UInt8Images) -> tuple[float, float]:
    """Return the mean luma of the true object, and by how much the drawn one is lighter.

    Both are of the pixels that neither image shows in white, of all views together; NaN for none.
    """
    true, other = truth @ LUMA, drawn @ LUMA
    shown = (true < WHITE) & (other < WHITE)
    if not shown.any():
        return np.nan, np.nan
    return true[shown].mean(), (other[shown] - true[shown]).mean()


def rows(directory: Path) -> Iterator[dict[str, object]]:
    """Return a row for each method, condition and object of a run whose images are there."""
    sources = Sources(StoredArtifacts(directory), {}, "")
    for name in sources.artifacts:
        if name.method == GROUND_TRUTH:
            continue
        truth, drawn = kept_images(sources, name.truth), kept_images(sources, name)
        luma, lighter = lightness(truth, drawn)
        kind = "dark" if luma < DARK else "light" if luma > LIGHT else "between"
        relative = (sharpness(drawn) / sharpness(truth)).mean()
        yield _fields(name) | {"luma": kind, "sharpness": relative, "lightness": lighter}


def _fields(name: JobName) -> dict[str, object]:
    return {"method": name.method, "condition": name.condition}


def summary(values: pd.DataFrame) -> pd.DataFrame:
    """Return a line for each method and condition, with the lightness of each kind of object."""
    keys = ["method", "condition"]
    by_kind = values.pivot_table("lightness", keys, "luma", sort=False).add_prefix("lightness, ")
    mean = values.groupby(keys, sort=False)["sharpness"].mean().to_frame()
    return mean.join(by_kind).reset_index()


def main() -> None:
    """Read the run of the command line."""
    parser = argparse.ArgumentParser(description="Sharpness and lightness of a run's images.")
    parser.add_argument("directory", type=Path)
    parser.add_argument("-o", "--out", type=Path)
    options = parser.parse_args()
    table = summary(pd.DataFrame(rows(options.directory)))
    lines = [[str(c) if isinstance(c, str) else f"{c:.3f}" for c in row] for row in table.values]
    print(markdown(list(table.columns), lines, left=2))
    if options.out:
        write_whole(options.out, table.to_csv(index=False).encode())


if __name__ == "__main__":
    main()
