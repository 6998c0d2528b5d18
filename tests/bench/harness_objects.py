"""Objects that behave and misbehave. Spawned workers import this module by its name."""

from __future__ import annotations

import json
import os
import signal
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from data_prep.datasets.objects import MeshObject
from data_prep.failures import BadInput
from data_prep.scene import Mesh


@dataclass(frozen=True)
class Tetrahedron(MeshObject):
    """A `data_prep.datasets.objects.SceneObject` that is cheap to make and to draw."""

    object_id: str = "a"
    class_name: str = "chair"

    def fingerprint(self) -> str:
        return f"tetrahedron {self.object_id}"

    def load(self) -> Mesh:
        vertices = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) / np.sqrt(3)
        faces = [[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]]
        colors = [[200, 60, 60], [60, 200, 60], [60, 60, 200], [120, 120, 120]]
        return Mesh(vertices, np.array(faces), np.array(colors))


class Refusing(Tetrahedron):
    def load(self) -> Mesh:
        raise BadInput("no such shape; draw one")


class Calling(Tetrahedron):
    """Calls exit(), as a careless library may."""

    def load(self) -> Mesh:
        raise SystemExit("enough")


class Dying(Tetrahedron):
    """Ends its process as a crash in native code does."""

    def load(self) -> Mesh:
        os._exit(7)


class Killed(Tetrahedron):
    def load(self) -> Mesh:
        os.kill(os.getpid(), signal.SIGKILL)
        raise AssertionError


@dataclass(frozen=True)
class Hanging(Tetrahedron):
    """Hangs for good, once it has said who it is."""

    pid_file: Path = Path()

    def load(self) -> Mesh:
        self.pid_file.write_text(str(os.getpid()))
        while True:
            time.sleep(60)


@dataclass(frozen=True)
class HangingOnce(Hanging):
    """Hangs where it has not said yet who it is."""

    def load(self) -> Mesh:
        return Tetrahedron.load(self) if self.pid_file.exists() else super().load()


class TellingItsProcess(Tetrahedron):
    """Fails with the number and the environment of its process as the reason."""

    def load(self) -> Mesh:
        raise BadInput(json.dumps({"pid": os.getpid()} | os.environ))
