"""The default scene of `data_prep.render`, and scenes that contain something more or less.

For the table of `benchmarks.scene_economy` only. A scene is a shader, a size, a number of samples
and a mesh; the default one gives the bytes of `data_prep.render.render`.
"""

from __future__ import annotations

import ctypes
import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from data_prep import render as renderer
from data_prep.scene import IMAGE_SIZE, Mesh, View

GAMMA = 2.2
# Over the observer's left shoulder when the front is seen; it stays with the object.
FIXED_LIGHT = (0.48, 0.72, -0.50)
CREASE_DEG = 30.0

VERTEX_SHADER = """#version 330 core
layout(location = 0) in vec3 position;
layout(location = 1) in vec3 color;
layout(location = 2) in vec3 normal;
uniform mat4 world_to_camera;
uniform mat4 camera_to_clip;
out vec3 eye_position;
out vec3 eye_normal;
flat out vec3 face_color;
void main() {
    vec4 eye = world_to_camera * vec4(position, 1.0);
    eye_position = eye.xyz;
    eye_normal = mat3(world_to_camera) * normal;
    face_color = color;
    gl_Position = camera_to_clip * eye;
}
"""
FRAGMENT_SHADER = """#version 330 core
in vec3 eye_position;
in vec3 eye_normal;
flat in vec3 face_color;
uniform mat4 world_to_camera;
out vec4 frag_color;
const float GAMMA = %(gamma)s;
void main() {
    vec3 facet = cross(dFdx(eye_position), dFdy(eye_position));
    float area = length(facet);
    vec3 normal = %(normal)s;
    float headlight = abs(normal.z);
    vec3 to_camera = normalize(-eye_position);
    vec3 seen = dot(normal, to_camera) < 0.0 ? -normal : normal;
    vec3 fixed_light = mat3(world_to_camera) * vec3(%(fixed)s);
    float shine = pow(abs(dot(normal, normalize(to_camera + vec3(0.0, 0.0, 1.0)))), 50.0);
    frag_color = vec4(%(color)s, 1.0);
}
"""
FLAT = "area > 0.0 ? facet / area : vec3(0.0, 0.0, 1.0)"
INTERPOLATED = f"length(eye_normal) > 0.0 ? normalize(eye_normal) : ({FLAT})"
LAMBERT = "face_color * pow(min(headlight, 1.0), 1.0 / GAMMA)"

Filter = Literal["none", "mean", "mean of light"]


@dataclass(frozen=True)
class Scene:
    """What is drawn, and how: the defaults are those of `data_prep.render`.

    normal, color  expressions of the fragment shader
    crease_deg     None: no normals per vertex. Else corners of facets that meet at one place share
                   a normal where the facets' own are at most this far apart.
    cull           faces seen from behind are left out
    size, samples  of the picture that is drawn, and of a pixel (1 or 4)
    reduce         how pixels that are smaller than those of IMAGE_SIZE are averaged to them, as
                   the driver does with samples: as sRGB values, or as light (linear)
    """

    normal: str = FLAT
    color: str = LAMBERT
    gamma: float = GAMMA
    crease_deg: float | None = None
    cull: bool = False
    size: int = IMAGE_SIZE
    samples: int = renderer.SAMPLES
    reduce: Filter = "none"


Vertices = tuple[NDArray[np.float32], NDArray[np.uint32]]  # [V, 9] with colour and normal; [F, 3]


def vertices_of(mesh: Mesh, crease_deg: float | None) -> Vertices:
    """What a scene uploads. Without normals (None) those columns are 0."""
    if crease_deg is None:
        vertices, faces = renderer._vertices_of_one_colour(mesh)
        return np.pad(vertices, ((0, 0), (0, 3))), faces
    corners = mesh.vertices[mesh.faces].reshape(-1, 3)
    colors = np.repeat(mesh.face_colors.astype(np.float32) / np.float32(255.0), 3, axis=0)
    normals = corner_normals(mesh, crease_deg).reshape(-1, 3).astype(np.float32)
    faces = np.arange(mesh.faces.size, dtype=np.uint32).reshape(-1, 3)
    return np.concatenate([corners, colors, normals], axis=1), faces


def corner_normals(mesh: Mesh, crease_deg: float) -> NDArray[np.float64]:
    """Unit normals [F, 3 corners, 3]: the mean over the facets that meet at a corner's place (by
    equal coordinates), weighted by area, of those at most `crease_deg` from the corner's own.

    A facet without area has normals (0, 0, 0).
    """
    points = mesh.vertices[mesh.faces].astype(np.float64)
    doubled = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
    length = np.linalg.norm(doubled, axis=1, keepdims=True)
    units = np.divide(doubled, length, out=np.zeros_like(doubled), where=length > 0)
    _, place = np.unique(mesh.vertices, axis=0, return_inverse=True)
    place = place.ravel()[mesh.faces].ravel()  # of each corner
    order = np.argsort(place, kind="stable")
    counts = np.bincount(place)
    starts = np.cumsum(counts) - counts
    sums = np.zeros((len(place), 3))
    limit = np.cos(np.radians(crease_deg)) - 1e-9
    for turn in range(counts.max(initial=0)):  # every corner looks at the turn-th of its place
        looking = np.flatnonzero(counts[place] > turn)
        other = order[starts[place[looking]] + turn] // 3
        near = (units[looking // 3] * units[other]).sum(axis=1) >= limit
        sums[looking[near]] += doubled[other[near]]
    norm = np.linalg.norm(sums, axis=1, keepdims=True)
    return np.divide(sums, norm, out=np.zeros_like(sums), where=norm > 0).reshape(-1, 3, 3)


def draw(scene: Scene, vertices: Vertices, views: Sequence[View]) -> NDArray[np.uint8]:
    """Pictures [V, S, S, 3], S = IMAGE_SIZE if the scene reduces them, else its own size.

    Raises MissingDependency where no GL context can be made.
    """
    context = _context()
    context.platform.make_current()
    drawn = context.draw(scene, vertices, views)
    if scene.reduce == "none":
        return drawn
    power = GAMMA if scene.reduce == "mean of light" else 1.0
    return reduced(drawn, scene.size // IMAGE_SIZE, power)


def reduced(pictures: NDArray[np.uint8], factor: int, power: float = 1.0) -> NDArray[np.uint8]:
    """Means over factor x factor pixels of levels to a power, [V, S, S, 3] to S / factor a side."""
    count, size = len(pictures), pictures.shape[1] // factor
    levels = (pictures.astype(np.float32) / np.float32(255.0)) ** np.float32(power)
    means = levels.reshape(count, size, factor, size, factor, 3).mean(axis=(2, 4))
    return np.floor(means ** np.float32(1 / power) * np.float32(255.0) + np.float32(0.5)).astype(
        np.uint8
    )


@dataclass(frozen=True, eq=False)
class _Context:
    gl: Any
    shaders: Any
    platform: Any
    programs: dict[str, Any]
    buffers: dict[tuple[int, int], tuple[int, int]]  # by size and samples: drawn to, and resolved

    def draw(self, scene: Scene, vertices: Vertices, views: Sequence[View]) -> NDArray[np.uint8]:
        gl, size = self.gl, scene.size
        data, faces = vertices
        gl.glBufferData(gl.GL_ARRAY_BUFFER, data.nbytes, data, gl.GL_STATIC_DRAW)
        gl.glBufferData(gl.GL_ELEMENT_ARRAY_BUFFER, faces.nbytes, faces, gl.GL_STATIC_DRAW)
        drawn, resolved = self.frame_buffers(size, scene.samples)
        matrix = self.use(scene)
        (gl.glEnable if scene.cull else gl.glDisable)(gl.GL_CULL_FACE)
        gl.glViewport(0, 0, size, size)
        pictures = np.empty((len(views), size, size, 3), np.uint8)
        for picture, view in zip(pictures, renderer._world_to_camera(views), strict=True):
            gl.glBindFramebuffer(gl.GL_FRAMEBUFFER, drawn)
            gl.glClear(gl.GL_COLOR_BUFFER_BIT | gl.GL_DEPTH_BUFFER_BIT)
            gl.glUniformMatrix4fv(matrix, 1, gl.GL_TRUE, view)
            gl.glDrawElements(gl.GL_TRIANGLES, faces.size, gl.GL_UNSIGNED_INT, ctypes.c_void_p(0))
            gl.glBindFramebuffer(gl.GL_DRAW_FRAMEBUFFER, resolved)
            area = (0, 0, size, size)
            gl.glBlitFramebuffer(*area, *area, gl.GL_COLOR_BUFFER_BIT, gl.GL_NEAREST)
            gl.glBindFramebuffer(gl.GL_READ_FRAMEBUFFER, resolved)
            pixels = gl.glReadPixels(*area, gl.GL_RGB, gl.GL_UNSIGNED_BYTE)
            picture[:] = np.frombuffer(pixels, np.uint8).reshape(size, size, 3)[::-1]
        return pictures

    def use(self, scene: Scene) -> int:
        """The scene's program, and where its view goes."""
        gl, shaders = self.gl, self.shaders
        fixed = np.array(FIXED_LIGHT) / np.linalg.norm(FIXED_LIGHT)
        source = FRAGMENT_SHADER % {
            "gamma": scene.gamma,
            "normal": scene.normal,
            "fixed": ", ".join(map(str, fixed)),
            "color": scene.color,
        }
        if source not in self.programs:
            self.programs[source] = shaders.compileProgram(
                shaders.compileShader(VERTEX_SHADER, gl.GL_VERTEX_SHADER),
                shaders.compileShader(source, gl.GL_FRAGMENT_SHADER),
            )
        program = self.programs[source]
        gl.glUseProgram(program)
        projection = gl.glGetUniformLocation(program, "camera_to_clip")
        matrix = renderer._projection().astype(np.float32)
        gl.glUniformMatrix4fv(projection, 1, gl.GL_TRUE, matrix)
        return gl.glGetUniformLocation(program, "world_to_camera")

    def frame_buffers(self, size: int, samples: int) -> tuple[int, int]:
        if (size, samples) not in self.buffers:
            gl, many = self.gl, 0 if samples == 1 else samples  # 0 is OpenGL's way to ask for one
            color = {gl.GL_COLOR_ATTACHMENT0: gl.GL_RGBA8}
            depth = {gl.GL_DEPTH_ATTACHMENT: gl.GL_DEPTH_COMPONENT24}
            self.buffers[size, samples] = (
                self._frame_buffer(size, many, color | depth),
                self._frame_buffer(size, 0, color),
            )
        return self.buffers[size, samples]

    def _frame_buffer(self, size: int, samples: int, attachments: dict[int, int]) -> int:
        gl = self.gl
        made = gl.glGenFramebuffers(1)
        gl.glBindFramebuffer(gl.GL_FRAMEBUFFER, made)
        for attachment, pixel in attachments.items():
            renderer._attach(gl, attachment)
            gl.glRenderbufferStorageMultisample(gl.GL_RENDERBUFFER, samples, pixel, size, size)
        return made


@functools.cache
def _context() -> _Context:
    renderer.gl_renderer()  # the project's context comes first, and goes last: it ends the display
    from OpenGL import GL
    from OpenGL.GL import shaders
    from pyrender.platforms.egl import EGLPlatform

    platform: Any = EGLPlatform(IMAGE_SIZE, IMAGE_SIZE)
    platform.init_context()
    GL.glEnable(GL.GL_DEPTH_TEST)
    GL.glClearColor(1.0, 1.0, 1.0, 1.0)
    GL.glBindVertexArray(GL.glGenVertexArrays(1))
    GL.glBindBuffer(GL.GL_ELEMENT_ARRAY_BUFFER, GL.glGenBuffers(1))
    GL.glBindBuffer(GL.GL_ARRAY_BUFFER, GL.glGenBuffers(1))
    for attribute in range(3):
        start = ctypes.c_void_p(12 * attribute)
        GL.glVertexAttribPointer(attribute, 3, GL.GL_FLOAT, GL.GL_FALSE, 36, start)
        GL.glEnableVertexAttribArray(attribute)
    return _Context(GL, shaders, platform, {}, {})
