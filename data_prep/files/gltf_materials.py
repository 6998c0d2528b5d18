"""The colours of faces by the materials of a glTF."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from data_prep.failures import BadInput
from data_prep.files.gltf_file import GltfFile, resource_name
from data_prep.files.mesh_contents import FaceColors, NotAMesh, grey_faces
from data_prep.files.safe_read import reason_of
from data_prep.files.textures import TextureReader, colors_at

_SPECULAR_GLOSSINESS = "KHR_materials_pbrSpecularGlossiness"
_TRANSFORM = "KHR_texture_transform"
_WEBP = "EXT_texture_webp"
_CLAMPED, _MIRRORED = 33071, 33648  # the ways of samplers beyond 0 to 1; any other one repeats


class GltfMaterials:
    """The materials of a file, and its textures."""

    def __init__(self, file: GltfFile) -> None:
        self._file = file
        self._textures = TextureReader(self._bytes)
        self._notes: list[str] = []

    @property
    def notes(self) -> list[str]:
        """Return lines on what is not there or cannot be read."""
        return self._notes + self._textures.notes

    def face_colors(
        self, primitive: dict[str, Any], faces: NDArray[np.int64], vertex_count: int
    ) -> FaceColors:
        """Return the colours uint8 [F, 3] of the faces of a primitive.

        They are the base colour times the texture in the middle of a face times the mean of the
        colours of its vertices; neutral grey where the file has none of these, or none that can be
        read.
        """
        try:
            return self._face_colors(primitive, faces, vertex_count)
        except BadInput:  # a texture that is too large
            raise
        except (NotAMesh, LookupError, TypeError, ValueError, AttributeError) as error:
            self._notes.append(f"a material cannot be read ({reason_of(error)})")
            return grey_faces(len(faces))

    def _face_colors(
        self, primitive: dict[str, Any], faces: NDArray[np.int64], vertex_count: int
    ) -> FaceColors:
        attributes = primitive.get("attributes", {})
        factor, texture = self._base(primitive.get("material"))
        linear = None if factor is None else np.tile(factor, (len(faces), 1))
        sampled = self._sampled(texture, attributes, faces) if texture else None
        if sampled is not None:
            linear = _linear(sampled) * (1.0 if linear is None else linear)
        if "COLOR_0" in attributes:
            colors = self._file.numbers(attributes["COLOR_0"])[:, :3]
            if colors.dtype.kind in "iu":  # its writer has forgotten `normalized`
                colors = colors / float(np.iinfo(colors.dtype).max)
            if len(colors) != vertex_count:
                self._notes.append(
                    f"{len(colors)} colours for {vertex_count} vertices are left out"
                )
            else:
                linear = colors[faces].mean(axis=1) * (1.0 if linear is None else linear)
        return grey_faces(len(faces)) if linear is None else _srgb(linear)

    def _base(self, index: int | None) -> tuple[NDArray[np.float64] | None, dict[str, Any] | None]:
        """Return the linear base colour [3] of a material, and its texture; None for each.

        White is the default of the specification, which writers leave out.
        """
        if index is None:
            return None, None
        material = self._file.element("materials", index)
        glossy = material.get("extensions", {}).get(_SPECULAR_GLOSSINESS)
        part, names = (
            material.get("pbrMetallicRoughness", {}),
            ("baseColorFactor", "baseColorTexture"),
        )
        if glossy is not None:
            part, names = glossy, ("diffuseFactor", "diffuseTexture")
        factor, texture = (part.get(name) for name in names)
        return np.array((factor or (1.0, 1.0, 1.0))[:3], np.float64), texture

    def _sampled(
        self, texture: dict[str, Any], attributes: dict[str, int], faces: NDArray[np.int64]
    ) -> NDArray[np.uint8] | None:
        """Return the colours of a texture in the middles of faces; None where it has none."""
        transform = texture.get("extensions", {}).get(_TRANSFORM, {})
        number = transform.get("texCoord", texture.get("texCoord", 0))
        of_file = self._file.element("textures", texture["index"])
        source = of_file.get("extensions", {}).get(_WEBP, of_file).get("source")
        if source is None or f"TEXCOORD_{number}" not in attributes:
            lost = "a texture has no image that can be read"
            if source is not None:
                lost = f"a texture is left out: the vertices have no TEXCOORD_{number}"
            self._notes.append(lost)
            return None
        name = resource_name(self._file.element("images", source).get("uri"))
        pixels = self._textures.pixels(name or f"images[{source}]")
        if pixels is None:
            return None
        corners = self._file.numbers(attributes[f"TEXCOORD_{number}"]).astype(np.float64)
        places = _transformed(corners[faces].mean(axis=1), transform)
        sampler = {}
        if "sampler" in of_file:
            sampler = self._file.element("samplers", of_file["sampler"])
        for axis, name in enumerate(("wrapS", "wrapT")):
            places[:, axis] = _wrapped(places[:, axis], sampler.get(name), pixels.shape[1 - axis])
        return colors_at(pixels, places)

    def _bytes(self, name: str) -> bytes | None:
        """Return the bytes of an image by its name, or by "images[N]" of one without."""
        if not name.startswith("images["):
            return self._file.resource(name)
        image = self._file.element("images", int(name[7:-1]))
        return self._file.buffer_view(image["bufferView"])


def _transformed(places: NDArray[np.float64], transform: dict[str, Any]) -> NDArray[np.float64]:
    """Return places [N, 2] in a texture as KHR_texture_transform moves them."""
    angle = transform.get("rotation", 0.0)
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    scaled = places * np.array(transform.get("scale", (1.0, 1.0)))
    return scaled @ turn.T + np.array(transform.get("offset", (0.0, 0.0)))


def _wrapped(
    places: NDArray[np.float64], wrap_mode: int | None, pixel_count: int
) -> NDArray[np.float64]:
    """Return places along an axis of a texture as its sampler takes those beyond 0 to 1."""
    if wrap_mode == _CLAMPED:
        half = 0.5 / pixel_count
        return np.clip(places, half, 1 - half)
    if wrap_mode == _MIRRORED:
        period = np.mod(places, 2.0)
        return np.where(period > 1, 2.0 - period, period)
    return places


def _linear(colors: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Return sRGB bytes as linear numbers of 0 to 1."""
    values = colors / 255.0
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


def _srgb(colors: NDArray[np.float64]) -> FaceColors:
    """Return linear numbers as sRGB bytes; those outside of 0 to 1 are cut, NaN becomes 0."""
    values = np.clip(np.nan_to_num(colors), 0.0, 1.0)
    curve = np.where(values <= 0.0031308, 12.92 * values, 1.055 * values ** (1 / 2.4) - 0.055)
    return np.floor(255.0 * curve + 0.5).astype(np.uint8)
