"""`bench score`: further metrics, also of other packages, on the stored images of a finished run.

Their scores are stored beside those of the run, whose own scores, tables and golden values stay as
they are.
"""

from __future__ import annotations

from typing import Annotated

import typer

from bench.analysis.run import read_run
from bench.catalogue.loaders import chosen_device
from bench.catalogue.metrics import FURTHER_METRICS, extractor_of
from bench.catalogue.plugins import find_metric
from bench.commands.options import DEVICE, Device, RunDirectory, names
from bench.finish import score_run
from data_prep.failures import BadInput
from data_prep.plugins import announced


def score(
    directory: RunDirectory,
    metrics: Annotated[
        str | None,
        typer.Option(
            help="Metrics, comma-separated: those on request (see 'bench list metrics'), or "
            "of installed packages. Default: all of installed packages."
        ),
    ] = None,
    device: Annotated[Device, typer.Option(help=DEVICE)] = Device.auto,
) -> None:
    """Measure a finished run with further metrics; print their tables."""
    if device is Device.cuda:
        chosen_device(device)  # without a GPU it raises BadInput, before a file is read
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
