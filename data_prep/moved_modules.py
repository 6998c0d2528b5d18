"""Modules under their old names until the next version, for packages that import them."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib import import_module
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType
from warnings import warn

NEW_NAMES = {
    "cloud_files": "files.clouds",
    "scan_files": "files.scans",
    "mesh_files": "files.meshes",
    "companions": "files.mesh_resources",
    "untrusted": "files.safe_read",
    "whole_files": "files.atomic_write",
    "fingerprints": "files.checksums",
    "orientations": "clouds.orientations",
    "render": "rendering.opengl",
    "rays": "rendering.raycast",
    "draw_mesh": "rendering.mesh",
    "camera": "rendering.camera",
    "dots": "rendering.dots",
    "images": "rendering.images",
    "conditions": "clouds.conditions",
    "extremes": "clouds.extremes",
    "sampling": "clouds.sampling",
    "normalise": "clouds.normalise",
    "dataset": "datasets.dataset",
    "dataset_exported": "datasets.exported",
    "dataset_folder": "datasets.folder",
    "dataset_modelnet": "datasets.modelnet",
    "dataset_paper": "datasets.paper",
    "dataset_procedural": "datasets.procedural",
    "dataset_shapenet": "datasets.shapenet",
    "scene_objects": "datasets.objects",
    "stored_meshes": "datasets.stored_meshes",
    "unpainted": "datasets.grey",
    "synsets": "datasets.synsets",
    "examine_paper": "datasets.paper_checks",
    "training_set": "datasets.training_set",
    "protocol_version": "datasets.protocol_version",
    "announced": "plugins",
}


class MovedModules(MetaPathFinder, Loader):
    """A finder of the modules of `NEW_NAMES` under their old names."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return a spec for an old name of `data_prep`; None for other names."""
        package, _, name = fullname.rpartition(".")
        return ModuleSpec(fullname, self) if package == __package__ and name in NEW_NAMES else None

    def exec_module(self, module: ModuleType) -> None:
        """Put the module of the new name into the place of `module`, with a DeprecationWarning."""
        old = module.__name__
        new = f"{__package__}.{NEW_NAMES[old.rpartition('.')[2]]}"
        warn(f"{old} is now {new}; the old name goes with the next version", DeprecationWarning, 2)
        sys.modules[old] = import_module(new)
