"""Meshes that are drawn themselves, and points of their surface."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

import bench
from data_prep.clouds.orientations import Orientation
from data_prep.failures import BadInput
from data_prep.files.meshes import load_mesh
from data_prep.rendering.opengl import render
from data_prep.scene import NEUTRAL_GREY, View, in_one_colour

RED = (255, 0, 0)
# A box of 2 x 4 x 6 millimetres, far from the origin; its front at -Z is the first face.
CORNERS = np.array([[x, y, z] for z in (-90, -84) for y in (0, 4) for x in (700, 702)])
SIDES = ((0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5))
COLOURS = (RED, *[(0, 40 * i, 255) for i in range(5)])
FRONT = ("--azimuth", "0", "--elevation", "0")


def write_box(path: Path) -> Path:
    """Write the box in the format of the suffix, in COLOURS where the format has any."""
    kind = path.suffix.lower()
    rows = "".join(f"{x} {y} {z}\n" for x, y, z in CORNERS)
    of_faces = [" ".join(map(str, side)) for side in SIDES]
    if kind == ".off":
        faces = [f"4 {a} {r} {g} {b}\n" for a, (r, g, b) in zip(of_faces, COLOURS, strict=True)]
        path.write_text(f"OFF\n8 6 0\n{rows}{''.join(faces)}")
    elif kind == ".ply":
        faces = [f"4 {a} {r} {g} {b}\n" for a, (r, g, b) in zip(of_faces, COLOURS, strict=True)]
        properties = "".join(f"property uchar {name}\n" for name in ("red", "green", "blue"))
        path.write_text(
            "ply\nformat ascii 1.0\nelement vertex 8\nproperty float x\nproperty float y\n"
            "property float z\nelement face 6\nproperty list uchar int vertex_indices\n"
            f"{properties}end_header\n{rows}{''.join(faces)}"
        )
    elif kind == ".obj":
        materials, faces = "", ""
        for i, (side, color) in enumerate(zip(SIDES, COLOURS, strict=True)):
            materials += f"newmtl m{i}\nKd {' '.join(str(c / 255) for c in color)}\n"
            faces += f"usemtl m{i}\nf {' '.join(str(corner + 1) for corner in side)}\n"
        path.with_suffix(".mtl").write_text(materials)
        vertices = "".join(f"v {row}\n" for row in rows.splitlines())
        path.write_text(f"mtllib {path.stem}.mtl\n{vertices}{faces}")
    else:
        triangles = [corners for a, b, c, d in SIDES for corners in ((a, b, c), (a, c, d))]
        shape = trimesh.Trimesh(CORNERS, triangles, process=False)
        material = trimesh.visual.material.PBRMaterial(baseColorFactor=(1.0, 0.0, 0.0, 1.0))
        if kind != ".stl":
            shape.visual = trimesh.visual.TextureVisuals(material=material)
        shape.export(path)
    return path


def pixels(path: Path) -> np.ndarray:
    return np.asarray(Image.open(path))


@pytest.mark.parametrize("suffix", ["obj", "ply", "off", "stl", "glb"])
def test_a_mesh_is_drawn_itself_in_its_colours(command, tmp_path, suffix: str) -> None:
    """The front shows the first face head on, in exactly its colour."""
    path, out = write_box(tmp_path / f"box.{suffix}"), tmp_path / "out.png"
    status, printed, err = command("render", path, *FRONT, "--size", "200", "-o", out)
    assert (status, printed) == (0, f"{out}\n")
    *_, note, drawn = err.splitlines()
    assert note == (
        f"note: {path}: the mesh itself is drawn, 12 triangles; --method draws from points of its "
        "surface"
    )
    assert drawn == "drawn by true-mesh; 'bench list' has others"
    image = pixels(out)
    assert (image[80:120, 90:110] == (NEUTRAL_GREY if suffix == "stl" else RED)).all()
    assert np.array_equal(image, render(load_mesh(path), (View(0, 0),), 200)[0])
    assert command("render", path, *FRONT, "--size", "200", "--colour", "grey", "-o", out)[0] == 0
    grey = render(in_one_colour(load_mesh(path), NEUTRAL_GREY), (View(0, 0),), 200)[0]
    assert np.array_equal(pixels(out), grey)


def test_python_draws_the_mesh_and_tells_so_in_its_words(tmp_path) -> None:
    path = write_box(tmp_path / "box.obj")
    said = "12 triangles; method= draws from points of its surface$"
    with pytest.warns(UserWarning, match=said):
        image = bench.draw_cloud(path, 30, 20)
    assert np.array_equal(image, render(load_mesh(path), (View(30, 20),))[0])
    with pytest.warns(UserWarning, match=said):
        clear = bench.draw_cloud(path, 30, 20, background="transparent", size=128)
    opaque = Image.alpha_composite(Image.new("RGBA", (128, 128), "white"), Image.fromarray(clear))
    assert np.abs(np.asarray(opaque)[..., :3].astype(int) - image).max() <= 1
    with pytest.raises(BadInput, match="method 'true-mesh' draws the mesh behind"):
        bench.draw_cloud(CORNERS, method="true-mesh")


def test_axes_of_the_file_and_its_scale_are_those_of_options(command, tmp_path) -> None:
    path, out = write_box(tmp_path / "box.off"), tmp_path / "out.png"
    assert command("render", path, *FRONT, "--up", "z", "--front", "x", "-o", out)[0] == 0
    mesh = load_mesh(path, Orientation("+Z", "+X", "the test"))
    assert np.array_equal(pixels(out), render(mesh, (View(0, 0),))[0])
    status, _, err = command("render", path, "--as-is", "-o", out)  # 700 units beside the camera
    assert status == 1
    assert err.endswith("bench: true-mesh: draw: 1 of 1 images are blank\n")


def test_a_method_draws_points_of_the_surface_beside_the_mesh_itself(command, tmp_path) -> None:
    path, out = write_box(tmp_path / "box.obj"), tmp_path / "out.png"
    ply, of_ply = write_box(tmp_path / "box.ply"), tmp_path / "of-ply.png"
    sampled = f"note: {path}: a mesh of 12 triangles: 2048 points of its surface are drawn, not its"
    for method in ("splat", "true-mesh,splat"):
        status, _, err = command("render", path, "--method", method, "-o", out)
        assert status == 0
        assert sampled in err
        assert ("the mesh itself is drawn" in err) == ("true-mesh" in method)
        assert "colours of its own" not in err
        assert command("render", ply, "--method", method, "-o", of_ply)[0] == 0
        assert np.array_equal(pixels(out), pixels(of_ply))
    turned = ("render", path, "--method", "true-mesh", "-o", tmp_path / "turn.webp")
    assert command(*turned, "--frames", "2")[0] == 0
    with Image.open(tmp_path / "turn.webp") as film:
        film.seek(1)
        last = np.asarray(film.convert("RGB"))
    assert np.array_equal(last, render(load_mesh(path), (View(210, 20),))[0])


def test_options_of_points_draw_points(command, tmp_path) -> None:
    path, out = write_box(tmp_path / "box.glb"), tmp_path / "out.png"
    for option in (("--points", "300"), ("--drop-far",), ("--budget", "50ms")):
        status, _, err = command("render", path, *option, "-o", out)
        count = 300 if "300" in option else 2048
        assert status == 0
        assert f"{count} points of its surface are drawn" in err
        assert "drawn by true-mesh" not in err


def test_a_folder_of_meshes_and_clouds(command, tmp_path) -> None:
    folder, out = tmp_path / "in", tmp_path / "out"
    folder.mkdir()
    write_box(folder / "a.obj")
    np.savetxt(folder / "b.xyz", np.random.default_rng(0).normal(size=(200, 3)))
    (folder / "c.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\n")
    (folder / "d.off").write_text("OFF\n3 1 0\n0 0 0\n1 0 0\n2 0 0\n3 0 1 2\n")
    status, printed, err = command("render", folder, "--size", "300", "-o", out)
    assert (status, printed) == (1, f"{out}/a.png\n{out}/b.png\n")
    lines = err.splitlines()
    for line in (
        f"note: {folder}: left out, no clouds or meshes by their names or contents: a.mtl",
        f"bench: {folder}/c.obj: the mesh has no faces; save its points as PLY or XYZ, and give "
        "that file",
        f"bench: {folder}/d.off: no face has an area; a shape needs a surface",
        "drawn by true-mesh, fused-net@grey; --budget 50ms is faster, 'bench list' has others",
    ):
        assert line in lines


def test_what_a_mesh_lacks_is_said_and_colours_that_are_wanted_are_there(
    command, refused, tmp_path
) -> None:
    path, out = write_box(tmp_path / "box.obj"), tmp_path / "out.png"
    path.with_suffix(".mtl").unlink()
    render_it = ("render", path, "-o", out)
    status, _, err = command(*render_it)
    assert status == 0
    assert f"note: {path}: the materials 'box.mtl'" in err
    problem = refused(*render_it, "--colour", "file")
    assert problem.startswith(f"{path}: no colours of its points")
    assert refused(*render_it, "--colour", "invented", "--method", "true-mesh").startswith(
        "method 'true-mesh' draws a mesh in its own colours; leave out"
    )


def test_corners_that_are_not_finite_cost_their_triangles(command, refused, tmp_path) -> None:
    path, out = write_box(tmp_path / "box.ply"), tmp_path / "out.png"
    path.write_text(path.read_text().replace("702 4 -84", "nan 4 -84"))
    assert "1 of 8 points are not finite" in refused("render", path, "-o", out)
    status, _, err = command("render", path, "--drop-invalid", "-o", out)
    assert status == 0
    left_out = [line for line in err.splitlines() if "triangles are left out" in line]
    assert len(left_out) == 1
    assert "of 12 triangles are left out, a corner is not finite" in left_out[0]
