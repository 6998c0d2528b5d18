"""`bench receipt` and `bench verify`: a run in 4 kB, and what others can say of it."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from bench.commands.options import (
    RunDirectory,
    WorkersOption,
    names,
    path_argument,
    path_option,
    worker_count,
)
from bench.receipts.receipt import make_receipt, to_text
from bench.receipts.verify import SHARE, VerifierChoices, random_seed
from bench.receipts.verify import verify as verify_receipt
from bench.tables.markdown import visible
from data_prep.files.atomic_write import write_whole


def receipt(
    directory: RunDirectory,
    out: Annotated[
        Path | None, path_option("The file. Default: print the receipt.", "--out", "-o")
    ] = None,
) -> None:
    """Make the receipt of a run: 4 kB by which others verify it with 'bench verify'."""
    text = to_text(make_receipt(directory))
    if out is None:
        print(text, end="")
        return
    write_whole(out, text.encode())
    print(f"written to {out}", file=sys.stderr)


def verify(
    path: Annotated[Path, path_argument("RECEIPT", "The file that 'bench receipt' has made.")],
    run: Annotated[
        Path | None,
        path_option("The folder of the run. Default: none, the receipt alone."),
    ] = None,
    share: Annotated[
        float,
        typer.Option(help="Part of the jobs to compute again, 0 to 1; 0 compares checksums alone."),
    ] = SHARE,
    seed: Annotated[
        int | None,
        typer.Option(help="Seed of their choice. Default: from the operating system, printed."),
    ] = None,
    dataset: Annotated[
        str | None,
        typer.Option(help="The dataset here, where its path is another. Default: the receipt's."),
    ] = None,
    images: Annotated[
        str | None,
        typer.Option(
            metavar="TREE,...",
            help="The trees of methods entered by images. Default: those that the run names.",
        ),
    ] = None,
    workers: WorkersOption = None,
) -> None:
    """Verify a receipt. Exit 0 if all agrees, 1 if something differs."""
    drawn_by = random_seed() if seed is None else seed
    trees = tuple(map(Path, names(images) or ()))
    choices = VerifierChoices(run, share, drawn_by, worker_count(workers), dataset, trees)
    verdict = verify_receipt(path, choices)
    for line in verdict.remarks:
        print(visible(line))
    for line in verdict.differences:
        print(visible(f"DIFFERS {line}"))
    if verdict.differences:
        print(f"not verified: {len(verdict.differences)} differences")
        raise typer.Exit(1)
    print("verified")
