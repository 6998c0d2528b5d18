"""`bench surface`: the meshes that the methods of a finished run make, against the true ones."""

from __future__ import annotations

from typing import Annotated

import typer

from bench.catalogue.methods import find_run_method
from bench.commands.options import RunDirectory, WorkersOption, names, worker_count
from bench.draw.kept_mesh import makes_surface
from bench.entered.claims import address_of
from bench.records.folder import read_finished
from bench.running.environment import cores
from bench.surfaces import measure_surfaces
from bench.tables.table import TABLES
from data_prep.failures import BadInput


def surface(
    directory: RunDirectory,
    methods: Annotated[
        str | None,
        typer.Option(help="Methods, comma-separated. Default: all of the run that make a mesh."),
    ] = None,
    workers: WorkersOption = None,
) -> None:
    """Score the meshes that methods of a run make, and say whether they order as images do."""
    manifest = read_finished(directory)
    known = manifest["methods"]
    able = [name for name in known if makes_surface(find_run_method(address_of(manifest, name)))]
    chosen = names(methods) or able
    if not chosen or not {*chosen} <= {*able}:
        raise BadInput(
            f"--methods {methods or ','.join(known)}: methods of this run that make a mesh are "
            f"{', '.join(able) or 'none'}; give some of these, or add one with 'bench add'"
        )
    for table in measure_surfaces(directory, chosen, worker_count(workers) or cores()):
        print(table.to_markdown())
    print(f"tables: {directory / TABLES}, surface*.csv and .md")
