"""Images of meshes by OpenGL (EGL) with one shader.

A mesh is uploaded once. Its views are drawn one after another into one small multisampled buffer,
which stays in the processor's cache. From there each is copied, with the mean of its samples, onto
one sheet, which is read back once. Of pyrender only the context is used: its renderer is slower and
does not shade the back of a face. A process makes one GL context and reuses it, with buffers for
each size of images. As OpenGL keeps global state, one thread at a time has the context, see
`_current_context`.
"""

from __future__ import annotations

import atexit
import ctypes
import functools
import math
import os
import sys
import threading
import types
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from data_prep.failures import MissingDependency
from data_prep.rendering.camera import (
    CAMERA_DISTANCE,
    FAR,
    FIELD_OF_VIEW_RAD,
    NEAR,
    camera_to_world,
    depth_range,
    lens_of,
)
from data_prep.scene import IMAGE_SIZE, NEUTRAL_GREY, AnyView, Mesh

# A part of the keys of finished work. Raise it when a change here changes a pixel, so that the work
# is done again.
VERSION = 1
_SHADERS = Path(__file__).parent
_SHADER_FILES = ("mesh.vert", "mesh.frag")
SAMPLES = 4  # samples in each pixel, whose mean smooths edges
BACKGROUND = (1.0, 1.0, 1.0)  # red, green and blue of pixels that nothing covers: white
SHEET_VIEWS = 32  # the most images on a sheet, where they are drawn one above the other
# The largest height of a sheet in pixels, which every OpenGL 4.1 supports.
SHEET_PX = 16_384
POSITION, COLOUR = 0, 1  # the numbers of a vertex's attributes, of three float32 each
# The Debian packages that rendering needs, each with the library that it is installed for.
# `.ci/libraries` installs the same.
DEBIAN_PACKAGES = {
    "libegl1": "libEGL.so.1",
    "libgl1": "libGL.so.1",
    "libopengl0": "libOpenGL.so.0",
    "libgomp1": "libgomp.so.1",
    "libusb-1.0-0": "libusb-1.0.so.0",
}
REMEDY = "install the Debian packages " + " ".join(DEBIAN_PACKAGES) + " (bench doctor checks them)"


def render(mesh: Mesh, views: Sequence[AnyView], size: int = IMAGE_SIZE) -> NDArray[np.uint8]:
    """Render a mesh by OpenGL.

    A facet seen head-on has exactly its own colour; tilted by an angle t its colour is multiplied
    by cos(t)^(1/2.2). Both sides of a facet are visible. An edge is smoothed with 4 samples a
    pixel. The same mesh and views give the same bytes on the same driver, in any process.

    Parameters
    ----------
    mesh : Mesh
        Mesh in unit-sphere coordinates; one without faces gives white images.
    views : sequence of View or Camera
        V camera positions.
    size : int
        Width and height of the images in pixels.

    Returns
    -------
    uint8 array [V, size, size, 3]
        Images on a white background.

    Raises
    ------
    ValueError
        If a vertex is not finite.
    MissingDependency
        If no GL context can be made.
    """
    if not np.isfinite(mesh.vertices).all():
        raise ValueError("render: the mesh has non-finite vertices")
    images = np.full((len(views), size, size, 3), 255, dtype=np.uint8)
    if len(mesh.faces) == 0 or len(views) == 0:
        return images
    poses = np.stack([camera_to_world(view) for view in views])
    matrices = np.linalg.inv(poses).astype(np.float32)
    projections = np.stack([_projection(view) for view in views]).astype(np.float32)
    with _current_context() as context:
        buffers = context.buffers(size)
        context.upload(*_vertices_of_one_colour(mesh))
        for start in range(0, len(views), buffers.views):
            stop = start + buffers.views
            context.draw(matrices[start:stop], projections[start:stop], mesh.faces.size, buffers)
            images[start:stop] = context.read(len(images[start:stop]), buffers)
    return images


def scene_values() -> dict[str, str]:
    """Return all values that decide a true image, beside the mesh, the view and the GL driver.

    These are the constants of the camera, of this module and of uncoloured meshes, and a checksum
    of the shaders without their comments, which hold the light. They are a part of the identity of
    true images, so that a change of one of them makes runs draw these again, without a version that
    somebody would have to raise.
    """
    lines = [
        line.partition("//")[0].strip()
        for name in _SHADER_FILES
        for line in (_SHADERS / name).read_text(encoding="utf-8").splitlines()
    ]
    return {
        "field_of_view_deg": f"{math.degrees(FIELD_OF_VIEW_RAD):.6f}",  # the same on any processor
        "camera_distance": str(CAMERA_DISTANCE),
        "image_size": str(IMAGE_SIZE),
        "samples": str(SAMPLES),
        "near": f"{NEAR:.6f}",
        "far": f"{FAR:.6f}",
        "background": " ".join(map(str, BACKGROUND)),
        "neutral_grey": " ".join(map(str, NEUTRAL_GREY)),
        "shaders": sha256("\n".join(filter(None, lines)).encode()).hexdigest(),
    }


def gl_renderer() -> str:
    """Return the name and version of the GL driver, on which images depend.

    Raises MissingDependency where no GL context can be made.
    """
    with _current_context() as context:
        gl = context.gl
        name, version = gl.glGetString(gl.GL_RENDERER), gl.glGetString(gl.GL_VERSION)
    return " / ".join(bytes(text or b"unknown").decode() for text in (name, version))


def _vertices_of_one_colour(mesh: Mesh) -> tuple[NDArray[np.float32], NDArray[np.uint32]]:
    """Return vertices [V, 6] with position and colour (x, y, z, r, g, b), and faces [F, 3].

    A vertex has the colour of its faces. Where faces of different colours share a vertex, each face
    of the mesh gets vertices of its own.
    """
    positions, faces = mesh.vertices, mesh.faces
    face_colors = mesh.face_colors.astype(np.float32) / np.float32(255.0)
    colors = np.zeros((len(positions), 3), np.float32)
    colors[faces] = face_colors[:, None]
    if not (colors[faces] == face_colors[:, None]).all():
        positions, colors = positions[faces].reshape(-1, 3), np.repeat(face_colors, 3, axis=0)
        faces = np.arange(faces.size)
    return np.concatenate([positions, colors], axis=1), faces.astype(np.uint32)


def _projection(view: AnyView) -> NDArray[np.float64]:
    """Return OpenGL's projection matrix [4, 4], from camera coordinates to the cube -1..1."""
    (focal_x, focal_y), (column, row) = lens_of(view)
    near, far = depth_range(view)
    half = IMAGE_SIZE / 2
    matrix = np.diag([focal_x / half, focal_y / half, (far + near) / (near - far), 0.0])
    matrix[:2, 2] = 1 - column / half, row / half - 1  # 0 where the axis meets the image's middle
    matrix[2, 3] = 2 * far * near / (near - far)
    matrix[3, 2] = -1.0
    return matrix


class _Buffers(NamedTuple):
    """The frame buffers for images of a size."""

    size: int
    views: int  # the number of images that fit on the sheet
    multisampled: int
    sheet: int


@dataclass(frozen=True, eq=False)
class _Context:
    """The GL context of a process, with buffers for each size of images used so far."""

    gl: Any  # PyOpenGL has no types
    egl: Any
    platform: Any
    view_matrix: int  # the location of the shader's uniform for the matrix of a view
    projection: int  # and of that for its projection
    buffers_by_size: dict[int, _Buffers] = field(default_factory=dict)

    def buffers(self, size: int) -> _Buffers:
        """Return the buffers for images of a size, and set the viewport to it."""
        if size not in self.buffers_by_size:
            self.buffers_by_size[size] = _make_buffers(self.gl, size)
        self.gl.glViewport(0, 0, size, size)
        return self.buffers_by_size[size]

    def release(self) -> None:
        """Release the context, so that another thread can make it current."""
        egl = self.egl
        nothing = (egl.EGL_NO_SURFACE, egl.EGL_NO_SURFACE, egl.EGL_NO_CONTEXT)
        egl.eglMakeCurrent(egl.eglGetCurrentDisplay(), *nothing)

    def upload(self, vertices: NDArray[np.float32], faces: NDArray[np.uint32]) -> None:
        """Replace the uploaded mesh."""
        gl = self.gl
        gl.glBufferData(gl.GL_ARRAY_BUFFER, vertices.nbytes, vertices, gl.GL_STATIC_DRAW)
        gl.glBufferData(gl.GL_ELEMENT_ARRAY_BUFFER, faces.nbytes, faces, gl.GL_STATIC_DRAW)

    def draw(
        self,
        world_to_camera: NDArray[np.float32],
        projections: NDArray[np.float32],
        indices: int,
        buffers: _Buffers,
    ) -> None:
        """Draw at most `buffers.views` views [V, 4, 4] of the uploaded mesh onto the sheet."""
        gl, size = self.gl, buffers.size
        for place, (matrix, projection) in enumerate(
            zip(world_to_camera, projections, strict=True)
        ):
            gl.glBindFramebuffer(gl.GL_FRAMEBUFFER, buffers.multisampled)
            gl.glClear(gl.GL_COLOR_BUFFER_BIT | gl.GL_DEPTH_BUFFER_BIT)
            gl.glUniformMatrix4fv(self.view_matrix, 1, gl.GL_TRUE, matrix)
            gl.glUniformMatrix4fv(self.projection, 1, gl.GL_TRUE, projection)
            gl.glDrawElements(gl.GL_TRIANGLES, indices, gl.GL_UNSIGNED_INT, ctypes.c_void_p(0))
            gl.glBindFramebuffer(gl.GL_DRAW_FRAMEBUFFER, buffers.sheet)
            bottom, top = size * place, size * (place + 1)
            image, on_sheet = (0, 0, size, size), (0, bottom, size, top)
            gl.glBlitFramebuffer(*image, *on_sheet, gl.GL_COLOR_BUFFER_BIT, gl.GL_NEAREST)

    def read(self, count: int, buffers: _Buffers) -> NDArray[np.uint8]:
        """Return the first images of the sheet, uint8 [count, size, size, 3]."""
        gl, size = self.gl, buffers.size
        gl.glBindFramebuffer(gl.GL_READ_FRAMEBUFFER, buffers.sheet)
        pixels = gl.glReadPixels(0, 0, size, size * count, gl.GL_RGB, gl.GL_UNSIGNED_BYTE)
        # OpenGL counts rows from below.
        return np.frombuffer(pixels, np.uint8).reshape(count, size, size, 3)[:, ::-1]


_one_at_a_time = threading.Lock()
os.register_at_fork(  # no process begins with half an image
    before=_one_at_a_time.acquire,
    after_in_parent=_one_at_a_time.release,
    after_in_child=_one_at_a_time.release,
)


@contextmanager
def _current_context() -> Iterator[_Context]:
    """Make the context current in this thread for a block, and then release it for others."""
    with _one_at_a_time:
        context = _context()
        context.platform.make_current()
        try:
            yield context
        finally:
            context.release()


@functools.cache
def _context() -> _Context:
    # Not a default that the environment may change: OSMesa draws other images.
    os.environ["PYOPENGL_PLATFORM"] = "egl"
    # Mesa draws in threads of its own, for which a forked process would wait for ever.
    mesa_decides = "LP_NUM_THREADS" not in os.environ
    if mesa_decides:
        os.environ["LP_NUM_THREADS"] = "0"
    # pyrender imports an interactive viewer, unused here, that needs pyglet and libGLU.
    viewer = types.ModuleType("pyrender.viewer")
    viewer.Viewer = None  # type: ignore[attr-defined]
    sys.modules.setdefault(viewer.__name__, viewer)
    try:
        from OpenGL import EGL, GL
        from OpenGL.GL import shaders
        from pyrender.platforms.egl import EGLPlatform, get_device_by_index

        device = get_device_by_index(int(os.environ.get("EGL_DEVICE_ID", "0")))
        platform = EGLPlatform(IMAGE_SIZE, IMAGE_SIZE, device)
        platform.init_context()  # and makes it current
        context = _set_up(GL, EGL, shaders, platform)
    except ModuleNotFoundError as error:
        package = str(error.name).partition(".")[0]
        raise MissingDependency(
            f"rendering needs the package {package}: run 'bench doctor --install'"
        ) from error
    except Exception as error:  # PyOpenGL reports a missing library in many ways
        raise MissingDependency(f"no OpenGL context ({error}): {REMEDY}") from error
    finally:
        if mesa_decides:
            del os.environ["LP_NUM_THREADS"]
    return context


@atexit.register  # before Python stops importing: PyOpenGL prints errors on stderr after that
def _delete_context() -> None:
    if _context.cache_info().currsize:
        _context().platform.delete_context()


def _set_up(gl: Any, egl: Any, shaders: Any, platform: Any) -> _Context:
    """Set the state of the context that is the same for any mesh, view and size."""
    gl.glEnable(gl.GL_DEPTH_TEST)
    gl.glClearColor(*BACKGROUND, 1.0)

    gl.glBindVertexArray(gl.glGenVertexArrays(1))
    gl.glBindBuffer(gl.GL_ELEMENT_ARRAY_BUFFER, gl.glGenBuffers(1))
    gl.glBindBuffer(gl.GL_ARRAY_BUFFER, gl.glGenBuffers(1))
    for attribute in (POSITION, COLOUR):
        start = ctypes.c_void_p(12 * attribute)
        gl.glVertexAttribPointer(attribute, 3, gl.GL_FLOAT, gl.GL_FALSE, 24, start)
        gl.glEnableVertexAttribArray(attribute)

    vertex, fragment = ((_SHADERS / name).read_text() for name in _SHADER_FILES)
    program = shaders.compileProgram(
        shaders.compileShader(vertex, gl.GL_VERTEX_SHADER),
        shaders.compileShader(fragment, gl.GL_FRAGMENT_SHADER),
    )
    gl.glUseProgram(program)
    view_matrix = gl.glGetUniformLocation(program, "world_to_camera")
    projection = gl.glGetUniformLocation(program, "camera_to_clip")
    return _Context(gl, egl, platform, view_matrix, projection)


def _make_buffers(gl: Any, size: int) -> _Buffers:
    def make(samples: int, height: int, *attachments: tuple[int, int]) -> int:
        buffer = gl.glGenFramebuffers(1)
        gl.glBindFramebuffer(gl.GL_FRAMEBUFFER, buffer)
        for attachment, pixel in attachments:
            pixels = gl.glGenRenderbuffers(1)
            gl.glBindRenderbuffer(gl.GL_RENDERBUFFER, pixels)
            gl.glFramebufferRenderbuffer(gl.GL_FRAMEBUFFER, attachment, gl.GL_RENDERBUFFER, pixels)
            store = gl.glRenderbufferStorageMultisample
            store(gl.GL_RENDERBUFFER, samples, pixel, size, height)
        return buffer

    colour = gl.GL_COLOR_ATTACHMENT0, gl.GL_RGBA8
    depth = gl.GL_DEPTH_ATTACHMENT, gl.GL_DEPTH_COMPONENT24
    views = min(SHEET_VIEWS, SHEET_PX // size)
    multisampled = make(SAMPLES, size, colour, depth)
    return _Buffers(size, views, multisampled, make(0, size * views, colour))
