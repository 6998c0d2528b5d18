"""The inputs of a run as a dataset of files, which can be cited and read back (`exported:PATH`).

The layout is that of `data_prep.datasets.exported`. Clouds, views and true images are made from the
jobs of the run's plan, so that a run on the exported files has the same inputs to the last bit.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from bench.catalogue.conditions import ALL, CONDITIONS
from bench.catalogue.lookup import find
from bench.catalogue.methods import FLOOR
from bench.catalogue.suites import SUITES, TRUTHS
from bench.records.folder import COLOURED, not_writable
from bench.running.options import Options, workers_of
from bench.running.plan import ObjectJobs, plan
from bench.running.pool import WorkerFailure, run_tasks
from bench.running.protocol import Protocol
from bench.running.work import cloud_under
from data_prep.datasets.exported import (
    CLOUDS,
    COLUMNS,
    METADATA,
    OBJECTS,
    UNPERTURBED,
    VIEWS,
    checksum_of,
)
from data_prep.datasets.objects import MeshObject
from data_prep.datasets.protocol_version import PROTOCOL_VERSION
from data_prep.failures import BadInput, StageFailure
from data_prep.files.atomic_write import whole_folder, write_whole
from data_prep.files.checksums import file_sha256
from data_prep.files.clouds import save_ply
from data_prep.progress import progress
from data_prep.rendering.camera import camera_to_world
from data_prep.scene import Mesh, UInt8Images

# The metadata that all exports share, in the form of Croissant; each null in it is replaced.
_CROISSANT = Path(__file__).with_name("croissant.json")
# The description of each list (objects, clouds, views) in the Croissant metadata.
_ABOUT = {
    OBJECTS: "The objects and their meshes.",
    CLOUDS: "The clouds that methods get: float32 coordinates in the unit sphere, +Y up, front -Z.",
    VIEWS: "True images, 128 x 128 RGB on white, with azimuth and elevation in degrees.",
}
# The types of the columns of the lists; all others are text.
_TYPES = {
    "protocol": "sc:Integer",
    "seed": "sc:Integer",
    "points": "sc:Integer",
    "view": "sc:Integer",
    "azimuth_deg": "sc:Float",
    "elevation_deg": "sc:Float",
}
Task = tuple[Path, str, ObjectJobs]  # the new folder, the object's path in it, and its jobs
# The rows of an object in each list, by the list's file name, without the class and the object.
Rows = dict[str, list[tuple[Any, ...]]]


def export(options: Options, out: Path) -> int:
    """Write the inputs of a run into a new folder, and return the number of objects.

    The folder is written whole or not at all. It has clouds under the conditions of the options (by
    default those of the suite; ("all",) stands for all of our own), and the unperturbed cloud in
    any case. Raises BadInput for a folder that is there already, for objects that cannot be
    exported and for clouds with colours, and CannotWrite.
    """
    if out.exists():
        raise BadInput(f"{out}: is there already; give a new folder with --out")
    if options.truth == "coloured-clouds":
        raise BadInput(
            "--truth coloured-clouds: an export keeps no colours of points; leave the option out"
        )
    suite = find(options.suite, SUITES, "suite")
    named = options.conditions or suite.conditions
    if named == (ALL,):
        named = tuple(condition.id for condition in CONDITIONS)
    conditions = tuple(dict.fromkeys((UNPERTURBED, *named)))
    # A protocol needs a method, whichever it is; `fresh`, because no run's folder is looked at.
    asked = replace(options, methods=(FLOOR,), conditions=conditions, fresh=True)
    protocol = Protocol.from_options(asked)
    objects = plan(protocol)
    try:
        with whole_folder(out) as new:
            _fill(new, protocol, objects, min(workers_of(suite, options), len(objects)))
    except OSError as error:
        raise not_writable(out, error) from error
    return len(objects)


def checksum_of_inputs(options: Options) -> str:
    """Return the checksum that an export of a run's inputs has; it is made, and removed again.

    Raises BadInput as `export`.
    """
    with TemporaryDirectory() as folder:
        out = Path(folder) / "export"
        export(options, out)
        return checksum_of(out)


def _fill(folder: Path, protocol: Protocol, objects: Iterable[ObjectJobs], workers: int) -> None:
    """Write the files of all objects in worker processes, then the lists and the metadata."""
    tasks: list[Task] = []
    for number, obj in enumerate(objects):
        tasks.append((folder, f"{obj.truth.object.class_name}/{number:05d}", obj))
    rows_of: dict[str, Rows] = {}  # of each object, by its path in the folder
    with progress("objects", len(tasks)) as advance:
        for (_, place, obj), rows in run_tasks(tasks, _write, workers, protocol.suite.limits):
            if isinstance(rows, WorkerFailure):
                raise BadInput(f"{obj.truth.object.object_id}: {rows.reason}; leave it out")
            rows_of[place] = rows
            advance(0)
    for name, columns in COLUMNS.items():
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(columns)
        of_run: tuple[Any, ...] = ()  # what the list of objects has in each row about the run
        if name == OBJECTS:
            of_run = (PROTOCOL_VERSION, protocol.seed, protocol.dataset)
        for _, place, obj in tasks:
            for row in rows_of[place][name]:
                writer.writerow((*obj.truth.name.object, *of_run, *row))
        write_whole(folder / name, text.getvalue().encode())
    text = json.dumps(_metadata(folder, protocol), indent=2, ensure_ascii=False) + "\n"
    write_whole(folder / METADATA, text.encode())


def _write(task: Task) -> Rows:
    """Write the files of an object, and return its rows in the lists. Runs in a worker process."""
    root, place, jobs = task
    without_mesh = ("", "")  # neither a file nor a checksum
    rows: Rows = {OBJECTS: [without_mesh], CLOUDS: [], VIEWS: []}
    obj, views = jobs.truth.object, jobs.truth.views

    def with_checksum(name: str) -> tuple[str, str]:
        return name, file_sha256(root / name)

    if isinstance(obj, MeshObject):
        name = f"meshes/{place}.ply"
        write_whole(root / name, _ply(obj.load()), synced=False)
        rows[OBJECTS] = [with_checksum(name)]
    for job in jobs.method_jobs:
        try:
            points = cloud_under(job, job.condition).points
        except StageFailure as error:  # raised by a condition of another package
            raise BadInput(f"{obj.object_id}: {error}; leave that condition out") from error
        name = f"clouds/{place}/{job.condition}.ply"
        save_ply(points, root / name)
        rows[CLOUDS].append((job.condition, len(points), *with_checksum(name)))
    for number, (view, image) in enumerate(zip(views, obj.truth(views), strict=True)):
        name = f"images/{place}/{number:02d}.png"
        write_whole(root / name, _png(image), synced=False)
        angles = repr(view.azimuth_deg), repr(view.elevation_deg)
        # With nine digits it is the same on all machines, whose cosines differ in their last bits.
        pose = " ".join(f"{each:.9f}" for each in camera_to_world(view).ravel())
        rows[VIEWS].append((number, *angles, pose, *with_checksum(name)))
    return rows


def _ply(mesh: Mesh) -> bytes:
    """Return a mesh as the bytes of a PLY file with a colour for each face."""
    import trimesh

    colors: Any = mesh.face_colors
    shape = trimesh.Trimesh(mesh.vertices, mesh.faces, face_colors=colors, process=False)
    data: Any = shape.export(file_type="ply")
    return data


def _png(image: UInt8Images) -> bytes:
    """Return an image [H, W, 3] as the bytes of a PNG file."""
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, "PNG", optimize=True)
    return buffer.getvalue()


def _metadata(folder: Path, protocol: Protocol) -> dict[str, Any]:
    """Return the metadata (JSON-LD) of an export, whose other files have been written."""
    lists = {name: file_sha256(folder / name) for name in COLUMNS}
    suite = protocol.suite.id
    if protocol.suite.truth != COLOURED:
        suite += f"-truth-{protocol.suite.truth}"
    described = json.loads(_CROISSANT.read_text(encoding="utf-8")) | {
        "name": f"pc2pix-bench-{suite}",
        "description": (
            f"Inputs of the benchmark pc2pix-bench, suite {protocol.suite.id} with images of "
            f"{TRUTHS[protocol.suite.truth]}, protocol {PROTOCOL_VERSION}: "
            f"{len(protocol.objects)} objects of {protocol.dataset}, seed {protocol.seed}, "
            f"{protocol.views} views each, conditions {', '.join(protocol.conditions)}. Paths and "
            "checksums of all files are in the lists."
        ),
        "version": f"{PROTOCOL_VERSION}.0.0",
        "identifier": checksum_of(folder),
        "datePublished": datetime.now(UTC).date().isoformat(),
    }
    if protocol.dataset.startswith("procedural"):
        described["license"] = "https://spdx.org/licenses/MIT.html"

    def list_file(name: str) -> dict[str, Any]:
        """Return the metadata of a list as a file."""
        file = {"@type": "cr:FileObject", "@id": name, "name": name, "description": _ABOUT[name]}
        return file | {"contentUrl": name, "encodingFormat": "text/csv", "sha256": lists[name]}

    def records(name: str) -> dict[str, Any]:
        """Return the metadata of the rows of a list, with the type of each column."""
        title = name.removesuffix(".csv")
        fields = [
            {
                "@type": "cr:Field",
                "@id": f"{title}/{column}",
                "name": column,
                "dataType": _TYPES.get(column, "sc:Text"),
                "source": {"fileObject": {"@id": name}, "extract": {"column": column}},
            }
            for column in COLUMNS[name]
        ]
        named = {"@id": title, "name": title, "description": _ABOUT[name]}
        return {"@type": "cr:RecordSet", **named, "field": fields}

    files = {"distribution": [*map(list_file, lists)], "recordSet": [*map(records, lists)]}
    return described | files
