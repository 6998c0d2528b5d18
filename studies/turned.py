"""Scores of methods on objects that stand upright, and on the same objects turned at random.

    python -m studies.turned METHOD [METHOD ...] [--meshes PATH]

The networks were trained on objects that stand upright, and a scan or a mesh of somebody else may
lie on its side. This writes `results/docs/turned.csv`: SSIM and LPIPS of each method, once upright
and once turned, on two objects of each class of `procedural:validation`, or on the first mesh of
each class of a folder. Clouds, views and conditions are those of `studies.upsampler`; the true
images are in grey.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

from bench.tables.table import csv_text
from data_prep.datasets.objects import GreyObject, SceneObject, TurnedObject
from data_prep.datasets.registry import open_dataset
from data_prep.files.atomic_write import write_whole
from studies.upsampler import CONDITIONS, measured, validation_objects

RESULTS = Path(__file__).resolve().parents[1] / "results" / "docs" / "turned.csv"
COLUMNS = ("method", "pose", "condition", "metric", "value")


def first_meshes(folder: Path) -> Iterator[SceneObject]:
    """Yield the first mesh of each class of a folder, in grey."""
    dataset = open_dataset(f"folder:{folder}")
    for name in open_dataset("procedural").classes:
        yield from map(GreyObject, dataset.objects(name, 1, 1))


def rows(method: str, objects: list[SceneObject]) -> Iterator[list[str]]:
    """Yield the lines of a method: of the objects upright, and of the same objects turned."""
    for pose, posed in (("upright", objects), ("turned", [TurnedObject(obj) for obj in objects])):
        scores = measured(method, posed)
        for condition in CONDITIONS:
            for metric in ("ssim", "lpips"):
                yield [method, pose, condition, metric, f"{scores[f'{metric} {condition}']:.4f}"]


def main() -> None:
    """Measure the methods of the command line, and write the file."""
    assert __doc__
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("methods", nargs="+")
    parser.add_argument("--meshes", type=Path)
    given = parser.parse_args()
    objects = list(first_meshes(given.meshes) if given.meshes else validation_objects())
    lines: list[list[str]] = []
    for method in given.methods:
        for line in rows(method, objects):
            print(*line, flush=True)
            lines.append(line)
    write_whole(RESULTS, csv_text(COLUMNS, lines).encode())


if __name__ == "__main__":
    main()
