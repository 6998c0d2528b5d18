"""Pictures of meshes: pyrender on EGL, with one shader that does what the scene requires.

pyrender 0.1.45 is the last release; four of its quirks are dealt with here and nowhere else: it
reads `np.infty` (gone in NumPy 2), it takes an integer background for black, its stock shader
neither shades the back of a face nor omits the specular term, and it imports an interactive viewer
that nobody here uses but which needs pyglet and libGLU. One GL context is made per process
and reused. OpenGL keeps global state: one thread only.
"""

from __future__ import annotations

import atexit
import functools
import os
import sys
import types
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data_prep.camera import CAMERA_DISTANCE, FIELD_OF_VIEW_RAD, camera_to_world
from data_prep.failures import MissingDependency
from data_prep.scene import IMAGE_SIZE, Mesh, View

VERSION = 1  # raise when a change here changes a pixel: finished work is then done again
SHADERS = Path(__file__).parent  # mesh.vert and mesh.frag, by pyrender's names
DEBIAN_PACKAGES = {  # and the library each is installed for; `.ci/libraries` installs the same
    "libegl1": "libEGL.so.1",
    "libgl1": "libGL.so.1",
    "libopengl0": "libOpenGL.so.0",
    "libgomp1": "libgomp.so.1",
    "libusb-1.0-0": "libusb-1.0.so.0",
}
REMEDY = "install the Debian packages " + " ".join(DEBIAN_PACKAGES) + " (bench doctor checks them)"


def render(mesh: Mesh, views: Sequence[View]) -> NDArray[np.uint8]:
    """Pictures of `mesh` from `views`: uint8 [V, IMAGE_SIZE, IMAGE_SIZE, 3], white background.

    A facet seen head-on has exactly its own colour; tilted by an angle t its colour is multiplied
    by cos(t)^(1/2.2). Both sides of a facet are visible. An edge is smoothed with 4 samples a
    pixel. An empty mesh gives white pictures. The same mesh and views give the same bytes on the
    same driver, in any process.

    Raises ValueError for non-finite vertices, MissingDependency where no GL context can be made.
    """
    if not np.isfinite(mesh.vertices).all():
        raise ValueError("render: the mesh has non-finite vertices")
    images = np.full((len(views), IMAGE_SIZE, IMAGE_SIZE, 3), 255, dtype=np.uint8)
    if len(mesh.faces) == 0:
        return images
    pyrender, renderer = _context()
    scene = pyrender.Scene(bg_color=[1.0, 1.0, 1.0, 1.0])
    scene.add(pyrender.Mesh([_primitive(pyrender, mesh)]))
    camera = scene.add(
        pyrender.PerspectiveCamera(
            yfov=FIELD_OF_VIEW_RAD,
            aspectRatio=1.0,
            # Reconstructions may leave the unit sphere; what lies outside this range is cut off.
            znear=0.05 * CAMERA_DISTANCE,
            zfar=2.5 * CAMERA_DISTANCE,
        )
    )
    flags = pyrender.RenderFlags.SKIP_CULL_FACES
    for image, view in zip(images, views, strict=True):
        scene.set_pose(camera, camera_to_world(view))
        image[:] = renderer.render(scene, flags=flags)[0]
    return images


def gl_renderer() -> str:
    """Name and version of the GL driver in use: part of a run's manifest, pictures depend on it.

    Raises MissingDependency where no GL context can be made.
    """
    _, renderer = _context()
    from OpenGL import GL

    renderer._platform.make_current()
    try:
        name, version = GL.glGetString(GL.GL_RENDERER), GL.glGetString(GL.GL_VERSION)
    finally:
        renderer._platform.make_uncurrent()
    return " / ".join(bytes(text or b"unknown").decode() for text in (name, version))


def _primitive(pyrender: Any, mesh: Mesh) -> Any:
    colors = mesh.face_colors.astype(np.float32) / np.float32(255.0)
    if (colors == colors[0]).all():
        material = pyrender.MetallicRoughnessMaterial(baseColorFactor=[*colors[0].tolist(), 1.0])
        return pyrender.Primitive(
            positions=mesh.vertices, indices=mesh.faces.astype(np.uint32), material=material
        )
    # A colour per face: no vertex can be shared between faces of different colours.
    opaque = np.concatenate([colors, np.ones((len(colors), 1), np.float32)], axis=1)
    return pyrender.Primitive(
        positions=mesh.vertices[mesh.faces].reshape(-1, 3),
        color_0=np.repeat(opaque, 3, axis=0),
        material=pyrender.MetallicRoughnessMaterial(),
    )


@functools.cache
def _context() -> tuple[Any, Any]:  # pyrender has no types
    # Not a default that the environment may change: pyrender draws without anti-aliasing on OSMesa.
    os.environ["PYOPENGL_PLATFORM"] = "egl"
    np.infty = np.inf  # type: ignore[attr-defined]  # noqa: NPY201
    viewer = types.ModuleType("pyrender.viewer")
    viewer.Viewer = None  # type: ignore[attr-defined]
    sys.modules.setdefault(viewer.__name__, viewer)
    try:
        import pyrender
        from pyrender.shader_program import ShaderProgramCache

        renderer: Any = pyrender.OffscreenRenderer(IMAGE_SIZE, IMAGE_SIZE)
    except ModuleNotFoundError as error:
        raise MissingDependency(
            f"rendering needs the package {error.name}: run 'make install'"
        ) from error
    except Exception as error:  # PyOpenGL reports a missing library in many ways
        raise MissingDependency(f"no OpenGL context ({error}): {REMEDY}") from error
    # While Python can still import: what PyOpenGL does after that ends in complaints on stderr.
    atexit.register(renderer.delete)
    renderer._renderer._program_cache = ShaderProgramCache(shader_dir=str(SHADERS))
    return pyrender, renderer
