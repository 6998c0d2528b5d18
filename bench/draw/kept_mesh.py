"""The surface that a method made of a cloud, as a PLY in the units and axes of the cloud's file."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

from scipy.spatial import cKDTree

from bench.catalogue.methods import METHODS, Method, find_method
from bench.draw.cloud_file import LoadedCloud
from bench.tables.markdown import visible
from data_prep.failures import BadInput
from data_prep.files.mesh_ply import save_surface
from data_prep.scene import Mesh

_NETWORKS = ("occupancy-net", "upsampled-wrap")  # the networks whose output is a surface


def makes_surface(method: Method) -> bool:
    """Return whether a method draws a surface that it has made; True for one of another package."""
    return method.kind in ("reconstruction", "") or method.family in _NETWORKS


def surface_methods() -> str:
    """Return the ids of the methods that make a surface, separated by commas."""
    return ", ".join(method.id for method in METHODS if makes_surface(method))


def check_kept(kept: Path, clouds: Sequence[Path], methods: Sequence[str]) -> None:
    """Raise BadInput where the surface of a method cannot be kept in a file of this name."""
    if kept.suffix.lower() != ".ply":
        raise BadInput(f"{kept}: a surface is written as PLY; give a name that ends in .ply")
    if len(clouds) > 1 or clouds[0].is_dir() or len(methods) > 1:
        raise BadInput(f"{kept}: keeps one surface; give one cloud and one method")
    if kept.is_dir() or not kept.absolute().parent.is_dir():
        raise BadInput(f"{kept}: is a folder, or in one that is not there; give another name")
    if kept.resolve() == clouds[0].resolve():
        raise BadInput(f"{kept}: is the cloud itself; give another name for the surface")
    method = find_method(methods[0])
    if not makes_surface(method):
        inner = ""
        if method.family == "fused-net":
            inner = " (the meshes inside it are a part of what its network sees)"
        raise BadInput(
            f"method '{method.id}' makes no surface that could be kept{inner}; give --method "
            f"with one of {surface_methods()}"
        )


def keep_mesh(kept: Path, cloud: Path, loaded: LoadedCloud, method_id: str, state: Any) -> None:
    """Write the surface in the prepared state of a method.

    kept    the file to write
    cloud   the file of the cloud, which the header names
    loaded  the cloud that was prepared; where it has colours, each corner of the surface has that
            of the nearest point

    Raises BadInput for a state without a surface, and CannotWrite.
    """
    mesh = getattr(state, "mesh", None)
    if not isinstance(mesh, Mesh):
        raise BadInput(f"{kept}: method '{method_id}' has made no surface; leave out --keep-mesh")
    comments = [
        f"pc2pix-bench {version('pc2pix-bench')}, method {method_id}: a surface of the points in "
        f"{cloud.name}, in the units and axes of that file",
        *getattr(state, "notes", ()),
    ]
    colors, points = loaded.cloud.colors, loaded.cloud.points
    if colors is not None:
        comments.append("colours: those of the nearest points")
        colors = colors[cKDTree(points).query(mesh.vertices)[1]]
    corners = loaded.orientation.to_file(loaded.place.restored(mesh.vertices))
    save_surface(kept, corners, mesh.faces, colors, list(map(visible, comments)))
