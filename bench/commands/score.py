"""`bench score`: metrics of a finished run's images, or of the images in two folders.

Scores of a run are stored beside its own. These, tables and golden values stay as they are.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from bench.analysis.run import read_run
from bench.catalogue.loaders import chosen_device
from bench.catalogue.metrics import FURTHER_METRICS, extractor_of
from bench.catalogue.plugins import find_metric
from bench.commands.options import (
    DEVICE,
    Device,
    expand_file,
    names,
    path_argument,
    path_option,
)
from bench.finish import score_run
from bench.folder_scores import score_folders
from data_prep.failures import BadInput
from data_prep.files.atomic_write import write_whole
from data_prep.plugins import announced


def score(
    directory: Annotated[
        Path, path_argument("DIR", "The folder of a finished run; with TRUTH a folder of images.")
    ],
    truth: Annotated[
        Path | None,
        path_argument("TRUTH", "A folder of true images with the same names. Default: none."),
    ] = None,
    metrics: Annotated[
        str | None,
        typer.Option(
            help="Metrics, comma-separated: those on request (see 'bench list metrics'), or "
            "of installed packages. Default: all of installed packages."
        ),
    ] = None,
    device: Annotated[Device, typer.Option(help=DEVICE)] = Device.auto,
    out: Annotated[
        Path | None, path_option("Of two folders: a CSV file, a row an image. Default: none.")
    ] = None,
    inception_weights: Annotated[
        str | None,
        typer.Option(
            help="Of two folders: weights for fid. Default: as downloaded before.",
            metavar="PATH|download",
        ),
    ] = None,
) -> None:
    """Measure a finished run with further metrics, or the images of two folders; print tables."""
    if device is Device.cuda:
        chosen_device(device)  # without a GPU it raises BadInput, before a file is read
    if truth is not None:
        if metrics is not None:
            raise BadInput("--metrics: is for the images of a run; leave it with two folders")
        table = score_folders(directory, truth, str(device), expand_file(inception_weights))
        if out is not None:
            write_whole(out, table.to_csv().encode(), remedy="give another --out")
        print(table.to_markdown(), end="")
        return
    for option, value in (("out", out), ("inception-weights", inception_weights)):
        if value is not None:
            raise BadInput(f"--{option}: is for two folders of images; give TRUTH, or leave it")
    chosen = names(metrics) or announced("metric")
    if not chosen:
        raise BadInput(
            f"no installed package adds a metric; give --metrics {','.join(FURTHER_METRICS)}, "
            "or see docs/extending.md"
        )
    run = read_run(directory)
    for line in run.not_measured:
        if line.partition(":")[0] in map(extractor_of, chosen):
            raise BadInput(
                f"{directory}: {line}; start the run again as this says, which measures it"
            )
    further = [find_metric(metric_id, str(device)) for metric_id in chosen]
    for table in score_run(run, further):
        print(table.to_markdown())
