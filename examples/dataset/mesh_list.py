"""A dataset for pc2pix-bench: objects.csv in a folder, a line `split,class,file` for each mesh."""

import csv
from pathlib import Path

from data_prep.clouds.orientations import Orientation
from data_prep.datasets.dataset import DatasetListing, DatasetReader
from data_prep.datasets.stored_meshes import MeshFile
from data_prep.failures import BadInput
from data_prep.files.safe_read import MIB, read_text

LIST = "objects.csv"
SPLITS = ("train", "validation", "test")
PLACED = Orientation("+Z", "-Y", "the description of the data")


def read(spec, root):
    """Return the objects of the list. Raises BadInput for one that is missing or malformed."""
    listing = DatasetListing()
    rows = csv.reader(read_text(root / LIST, 4 * MIB).splitlines())
    for number, row in enumerate(rows, 1):
        if len(row) != 3 or row[0] not in SPLITS:
            raise BadInput(f"{root / LIST}:{number}: expected split,class,file")
        split, class_name, name = row
        if Path(name).is_absolute() or ".." in Path(name).parts:
            raise BadInput(f"{root / LIST}:{number}: a file outside the folder")
        file = root / name
        mesh = MeshFile(class_name, name, file, file.parent, PLACED)
        listing.objects.append(mesh)
        listing.splits.setdefault(split, []).append(mesh)
    if not listing.objects:
        raise BadInput(f"{root / LIST}: no object in this list")
    return listing.dataset(spec, f"meshes listed in {LIST}", PLACED.message)


DATASET = DatasetReader("mesh-list", read, "meshes named by objects.csv, with +Z up")
