"""Scores of the images in a folder against those of the same names in another, without a run."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bench.analysis.digits import decimals
from bench.catalogue.metrics import (
    FID,
    extractor_of,
    find_extractor,
    higher_is_better,
    lpips_network,
)
from bench.metrics.frechet import frechet_distance
from bench.metrics.inception_weights import WeightsUnavailable
from bench.metrics.peak_signal_to_noise import psnr
from bench.metrics.structural_similarity import ssim_per_image
from bench.records.folder import MANIFEST
from bench.tables.grid import Block, grid, number_text
from bench.tables.table import Table
from data_prep.arrays import Floats
from data_prep.failures import BadInput
from data_prep.files.safe_read import files_below
from data_prep.progress import progress
from data_prep.rendering.images import read_any_image

_SUFFIXES = (".png", ".jpg", ".jpeg", ".webp")
_LEAST_SIDE = 31  # pixels, which the network of LPIPS needs
_MOST_NAMED = 3  # images that a message names of each folder
# Takes true and other images, uint8 [1, H, W, 3] each, and returns a score [1].
_Score = Callable[[NDArray[np.uint8], NDArray[np.uint8]], Floats]


def image_pairs(images: Path, truth: Path) -> dict[str, tuple[Path, Path]]:
    """Return the files of each image and of its truth, by their name: the path without suffix.

    Raises BadInput for a folder without images or of a run, for two images of one name, and for
    images without a partner.
    """
    ours, true = _images_in(images), _images_in(truth)
    lacking = []
    for folder, names, others in ((images, ours, true), (truth, true, ours)):
        alone = sorted(names.keys() - others.keys())
        named = ", ".join(islice(alone, _MOST_NAMED))
        if alone:
            lacking.append(f"{len(alone)} of {len(names)} only in {folder} ({named})")
    if lacking:
        raise BadInput(f"images without a partner: {'; '.join(lacking)}; give both the same names")
    return {name: (path, true[name]) for name, path in ours.items()}


def _images_in(folder: Path) -> dict[str, Path]:
    if (folder / MANIFEST).exists():
        raise BadInput(f"{folder}: is the folder of a run; 'bench score {folder}' alone scores it")
    paths: dict[str, Path] = {}
    for path in files_below(folder, _SUFFIXES)[0]:
        name = str(path.relative_to(folder).with_suffix(""))
        if name in paths:
            raise BadInput(f"{path}: {paths[name].name} has the same name; remove one of them")
        paths[name] = path
    if not paths:
        raise BadInput(f"{folder}: no images in it ({', '.join(_SUFFIXES)}); give another folder")
    return paths


def score_folders(
    images: Path,
    truth: Path,
    device: str = "cpu",
    inception_weights: str | None = None,
) -> Table:
    """Score the images of a folder against those of the same names in another.

    device             where networks run: "auto", "cpu" or "cuda"
    inception_weights  as the option of `bench run`: FID is left out where they are not here

    Returns a table with a row an image, which people see as means, worst images and notes. Raises
    BadInput as `image_pairs`, and for images that cannot be compared.
    """
    pairs, notes = image_pairs(images, truth), list[str]()
    metrics: dict[str, _Score] = {"psnr": psnr, "ssim": lambda *pair: ssim_per_image(*pair).ssim}
    weights: dict[str, str] = {}
    for metric in ("lpips", FID):
        try:
            path = find_extractor(extractor_of(metric)).weights(inception_weights)
            weights[metric] = str(path)
        except WeightsUnavailable as error:
            notes.append(f"{metric}: not measured, {error}")
    if "lpips" in weights:
        network = lpips_network(weights["lpips"], device)
        metrics["lpips"] = lambda *pair: network.distance(*map(network.encode, pair))
    features_of = find_extractor(FID).load(weights[FID], device) if FID in weights else None
    rows, features, transparent = list[dict[str, Any]](), list[list[Floats]](), 0
    with progress("images", len(pairs)) as advance:
        for name, paths in pairs.items():
            (drawn, of_drawn), (true, of_true) = map(read_any_image, paths)
            _check_sizes(paths, drawn, true)
            transparent += of_drawn + of_true
            pair = true[None], drawn[None]
            scores = {metric: float(score(*pair)[0]) for metric, score in metrics.items()}
            rows.append({"image": name, **scores})
            if features_of is not None:
                features.append([features_of(image)[0] for image in pair])
            advance(0)
    if len(features) > 1:
        distance = frechet_distance(*map(np.stack, zip(*features, strict=True)))
        notes.append(f"fid: {number_text(distance, decimals(FID))}, of all images")
    elif features:
        notes.append("fid: not measured, it needs two images")
    if transparent:
        notes.append(f"images with transparent pixels, which are laid on white: {transparent}")
    title = f"{images} against {truth}: {len(rows)} images"
    return Table("scores", title, pd.DataFrame(rows), partial(_summary, notes=notes))


def _check_sizes(
    paths: tuple[Path, Path], drawn: NDArray[np.uint8], true: NDArray[np.uint8]
) -> None:
    """Raise BadInput for images of two sizes, and for smaller ones than metrics need."""
    height, width = drawn.shape[:2]
    if drawn.shape != true.shape:
        raise BadInput(
            f"{paths[0]}: {width} x {height} pixels, and {paths[1]} has {true.shape[1]} x "
            f"{true.shape[0]}; scale one of them"
        )
    if min(height, width) < _LEAST_SIDE:
        raise BadInput(
            f"{paths[0]}: {width} x {height} pixels, and lpips needs {_LEAST_SIDE}; enlarge both"
        )


def _summary(frame: pd.DataFrame, notes: Sequence[str]) -> Iterator[Block]:
    """Yield a grid with a line for each metric, and the notes."""
    lines = []
    for metric in frame.columns[1:]:
        values, higher = frame[metric].to_numpy(), higher_is_better(metric)
        place = int(values.argmin() if higher else values.argmax())
        mean, worst = (
            number_text(value, decimals(metric)) for value in (values.mean(), values[place])
        )
        better = "higher" if higher else "lower"
        lines.append((metric, better, mean, worst, frame["image"].iloc[place], str(len(values))))
    heads = ("metric", "better", "mean", "worst", "of image", "images")
    yield grid(heads, lines, caption="mean and worst image of each metric", notes=tuple(notes))
