"""Images of our real meshes by published networks of others, and their scores.

    python -m studies.others_weights NAME --repository DIR --meshes PATH --out TREE
        [--limit N] [--conditions 2048,512]
    python -m studies.others_weights table --run RUN [RUN ...]

DIR is a clone of the network's repository, at the commit that `studies.others_networks` states; its
weights must have the checksums that are stated there. Grad-PU needs `pip install einops` besides.

The first command exports the clouds of all meshes (`bench data export`) into the folder `export`
beside TREE, once for all networks, and draws those that TREE lacks: it can be stopped and started
again at any time. TREE is then a method of a run:

    bench run --suite thirteen-classes --dataset exported:EXPORT --truth grey --limit 1 --views 4
        --conditions 2048,512,noise-0.05,noise-0.10 --methods images:TREE,fused-net@grey --out RUN

TREE/times.csv has the processor's time of each cloud, and the reason where a network failed. The
second command writes, from finished runs with such methods, `results/docs/others-weights.csv`, and
`others-weights-rivals.csv`, comparisons of `fused-net@grey` with the networks, object by object.
"""

from __future__ import annotations

import argparse
import csv
import io
import json
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator, Mapping
from itertools import product
from pathlib import Path

import numpy as np
import torch
from PIL import Image

from bench.analysis.paper import AVERAGE
from bench.analysis.run import read_run
from bench.entered.claims import CLAIMS, ENTERED, TREE
from bench.records.folder import read_manifest
from bench.running.environment import machine_info
from bench.tables.table import csv_text
from data_prep.datasets.exported import ExportedObject, checksum_of
from data_prep.datasets.registry import open_dataset
from data_prep.failures import BadInput, StageFailure
from data_prep.files.atomic_write import write_whole
from data_prep.files.checksums import file_sha256
from data_prep.progress import log, progress
from data_prep.randomness import generator
from data_prep.rendering.mesh import draw_mesh
from studies.documents import NUMBERS
from studies.measurements import BEST_LEARNED, FIRST, differences, rivals_of, values
from studies.others_networks import NETWORKS, Network, Surface, surface_of

CONDITIONS = "2048,512,noise-0.05,noise-0.10"
VIEWS = 4
_BY_NAME = {network.name: network for network in NETWORKS}
ADDRESS = "https://github.com"
TIMES = "times.csv"
Key = tuple[str, str, str]  # condition, class and object
_COLUMNS = ("condition", "class", "object", "cpu_s", "failure")
_VALUES = ("method", "condition", "class", "metric", "value", "ci_low", "ci_high", "n")


def check_repository(network: Network, folder: Path) -> None:
    """Check that a folder has a network's repository and its weights.

    Raises BadInput, naming the folder or the file, for another commit and another checksum.
    """
    git = ["git", "-C", str(folder), "rev-parse", "HEAD"]
    head = subprocess.run(git, capture_output=True, text=True, check=False).stdout.strip()
    if head != network.commit:
        raise BadInput(
            f"{folder}: at {head or 'no commit'}, not {network.commit}; check that out in a clone "
            f"of {ADDRESS}/{network.repository}"
        )
    for name, expected in network.weights.items():
        path = folder / network.folder / name
        if not path.is_file() or file_sha256(path) != expected:
            raise BadInput(f"{path}: not the published weights; check out {network.commit} again")


def exported(meshes: Path, tree: Path) -> Path:
    """Return the export of the meshes beside a tree, which is made where it is missing."""
    folder = tree.with_name("export")
    if not folder.exists():
        arguments = ["--suite", "thirteen-classes", "--dataset", f"folder:{meshes}"]
        arguments += ["--truth", "grey", "--conditions", CONDITIONS, "--views", str(VIEWS)]
        bench = Path(sys.executable).with_name("bench")
        subprocess.run([bench, "data", "export", *arguments, "--out", folder], check=True)
    return folder


def wanted(
    export: Path, conditions: str, limit: int | None
) -> Iterator[tuple[Key, ExportedObject]]:
    """Yield the clouds of an export, condition by condition, with their objects.

    conditions  separated by commas
    limit       number of objects of each class; None for all
    """
    dataset = open_dataset(f"exported:{export}")
    for condition, class_name in product(conditions.split(","), dataset.classes):
        for obj in dataset.objects(class_name, limit, 0):
            assert isinstance(obj, ExportedObject)
            yield (condition, class_name, obj.object_id), obj


def draw(
    network: Network,
    repository: Path,
    export: Path,
    tree: Path,
    clouds: Iterable[tuple[Key, ExportedObject]],
) -> None:
    """Draw those clouds of an export that a tree lacks, and state what the images are.

    Raises BadInput for another repository, and for a tree of another export.
    """
    check_repository(network, repository)
    checksum = checksum_of(export)
    if (tree / CLAIMS).exists() and checksum not in (tree / CLAIMS).read_text("utf-8"):
        raise BadInput(f"{tree}: has images of another export; give another --out")
    rows = times(tree)
    drawn = {tuple(row[column] for column in _COLUMNS[:3]) for row in rows}
    lacking = [(key, obj) for key, obj in clouds if key not in drawn]
    if not lacking:
        return
    surface = surface_of(network, repository)
    with progress(network.name, len(lacking)) as advance:
        for key, obj in lacking:
            rows.append(_drawn(surface, tree, key, obj))
            write_whole(tree / CLAIMS, _claims(network, checksum, rows).encode())
            write_whole(tree / TIMES, csv_text(_COLUMNS, (row.values() for row in rows)).encode())
            advance(sum(bool(row["failure"]) for row in rows))


def _drawn(surface: Surface, tree: Path, key: Key, obj: ExportedObject) -> dict[str, str]:
    """Draw the images of a cloud, and return its row of times."""
    torch.manual_seed(int(generator("others' weights", *key).integers(2**31)))
    cloud = obj.perturbed(key[0])
    assert cloud is not None
    start, failure = time.process_time(), ""
    try:
        with torch.no_grad():
            mesh = surface(cloud.points)
    except (StageFailure, RuntimeError, ValueError, IndexError) as error:
        failure = str(error).splitlines()[0]
        log(f"{'/'.join(key)}: {failure}")
    else:
        for number, image in enumerate(draw_mesh(mesh, obj.exported_views)):
            png = io.BytesIO()
            Image.fromarray(image).save(png, "PNG")
            write_whole(tree.joinpath(*key, f"{number:02d}.png"), png.getvalue(), synced=False)
    seconds = f"{time.process_time() - start:.2f}"
    return dict(zip(_COLUMNS, (*key, seconds, failure), strict=True))


def times(tree: Path) -> list[dict[str, str]]:
    """Return the rows of a tree's times, one for each cloud that was drawn or failed."""
    path = tree / TIMES
    return list(csv.DictReader(io.StringIO(path.read_text("utf-8")))) if path.exists() else []


def _claims(network: Network, checksum: str, rows: Iterable[Mapping[str, str]]) -> str:
    """Return the text of the file that states what the images of a tree are."""
    facts = {
        "name": network.name,
        "source": f"{network.about}, {ADDRESS}/{network.repository}, commit {network.commit}",
        "trained_on": network.trained_on,
        "hardware": f"one core, {machine_info()['machine']['cpu']}",
        "prepare_s": float(np.mean([float(row["cpu_s"]) for row in rows])),
        "draw_s": 0.0,  # within that of a cloud
        "licence": f"of the network: {network.licence}",
        "export": checksum,
        "version": network.commit[:7],
    }
    return "".join(f"{key} = {json.dumps(value)}\n" for key, value in facts.items())


def table(directories: Iterable[Path]) -> str:
    """Return the mean scores of runs as a CSV text, with costs, failures and licences of networks.

    Networks have the mean seconds of the processor for a cloud. Raises BadInput for a run that
    cannot be read.
    """
    rows: list[dict[str, str]] = []
    for directory in directories:
        run = read_run(directory)
        entered = run.manifest.get(ENTERED, {})
        for row in csv.DictReader(io.StringIO(values(run, ("ssim", "lpips")))):
            name, condition = row["method"], row["condition"]
            jobs = run.jobs[(run.jobs["method"] == name) & (run.jobs["condition"] == condition)]
            if row["class"] != AVERAGE or jobs.empty:  # best-classical has the jobs of others
                continue
            line = {column: row[column] for column in _VALUES}
            line |= {"meshes": str(len(jobs)), "failed": str(int((jobs["drawn"] == 0).sum()))}
            line |= dict.fromkeys(("cpu_s", "licence", "commit"), "")
            if name in entered:
                objects = set(zip(jobs["class"], jobs["object"], strict=True))
                seconds = []
                for time_row in times(Path(entered[name][TREE])):
                    key = time_row["class"], time_row["object"]
                    if time_row["condition"] == condition and key in objects:
                        seconds.append(float(time_row["cpu_s"]))
                network = _BY_NAME[name]
                line["cpu_s"] = f"{np.mean(seconds):.2f}"
                line |= {"licence": network.licence, "commit": network.commit[:7]}
            rows.append(line)
    return csv_text(list(rows[0]), (row.values() for row in rows))


def comparisons(directories: Iterable[Path]) -> str:
    """Return comparisons of the networks in runs with `fused-net@grey` as a CSV text."""
    rows: list[dict[str, str]] = []
    for directory in directories:
        networks = read_manifest(directory).get(ENTERED, {})
        compared = differences(directory, networks, FIRST, BEST_LEARNED)
        rows += csv.DictReader(io.StringIO(compared))
    return csv_text(list(rows[0]), (row.values() for row in rows))


def main() -> None:
    """Draw with a network, or write the table."""
    assert __doc__
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("name", choices=[*_BY_NAME, "table"])
    parser.add_argument("--repository", type=Path)
    parser.add_argument("--meshes", type=Path)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--limit", type=int, help="objects of each class; default: all")
    parser.add_argument("--conditions", default=CONDITIONS)
    parser.add_argument("--run", type=Path, nargs="+")
    given = parser.parse_args()
    torch.set_num_threads(1)
    try:
        if given.name == "table":
            write_whole(NUMBERS / "others-weights.csv", table(given.run).encode())
            write_whole(NUMBERS / rivals_of("others-weights"), comparisons(given.run).encode())
        else:
            export = exported(given.meshes, given.out)
            clouds = wanted(export, given.conditions, given.limit)
            draw(_BY_NAME[given.name], given.repository, export, given.out, clouds)
    except BadInput as error:
        sys.exit(str(error))


if __name__ == "__main__":
    main()
