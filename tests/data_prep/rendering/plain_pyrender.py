"""Images of meshes by pyrender's own renderer, as `data_prep.rendering.opengl` drew them at first.

The bytes are the same. A scene is made for each mesh and rendered from one view after another;
pyrender looks up program and uniforms, resolves and reads back colour and depth for each.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data_prep.rendering import opengl as render
from data_prep.rendering.camera import FIELD_OF_VIEW_RAD, camera_to_world
from data_prep.scene import IMAGE_SIZE, Mesh, View

SHADERS = Path(__file__).parent / "plain_pyrender_shaders"  # mesh.vert and mesh.frag


def render_plainly(mesh: Mesh, views: Sequence[View]) -> NDArray[np.uint8]:
    """Return images of `mesh` (with at least one face): uint8 [V, IMAGE_SIZE, IMAGE_SIZE, 3]."""
    pyrender, renderer = _renderer()
    scene = pyrender.Scene(bg_color=[1.0, 1.0, 1.0, 1.0])
    scene.add(pyrender.Mesh([_primitive(pyrender, mesh)]))
    camera = scene.add(
        pyrender.PerspectiveCamera(
            yfov=FIELD_OF_VIEW_RAD, aspectRatio=1.0, znear=render.NEAR, zfar=render.FAR
        )
    )
    images = np.empty((len(views), IMAGE_SIZE, IMAGE_SIZE, 3), np.uint8)
    for image, view in zip(images, views, strict=True):
        scene.set_pose(camera, camera_to_world(view))
        image[:] = renderer.render(scene, flags=pyrender.RenderFlags.SKIP_CULL_FACES)[0]
    return images


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
def _renderer() -> tuple[Any, Any]:
    render.gl_renderer()  # the project's context comes first, and goes last: it ends the display
    np.infty = np.inf  # type: ignore[attr-defined]  # noqa: NPY201
    import pyrender
    from pyrender.shader_program import ShaderProgramCache

    renderer: Any = pyrender.OffscreenRenderer(IMAGE_SIZE, IMAGE_SIZE)
    renderer._renderer._program_cache = ShaderProgramCache(shader_dir=str(SHADERS))
    return pyrender, renderer
