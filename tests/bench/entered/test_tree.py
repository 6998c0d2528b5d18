"""Trees of images: what their author states, which files they have, which a run may use."""

from __future__ import annotations

import json
import os
import shutil
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from bench.catalogue.methods import entered_method, find_method, find_run_method
from bench.entered.claims import Claims, address_of, entered_claims, manifest_entry, read_claims
from bench.entered.tree import ImageTree
from data_prep.datasets.exported import ExportedObject, StoredFile
from data_prep.failures import BadInput, StageFailure
from data_prep.scene import CloudOrigin, PointCloud, View

from ..builders import refusal

STATED = {
    "name": "neural-points",
    "source": "a network over points, arXiv:0000.00000",
    "trained_on": "ShapeNet cars",
    "hardware": "one H100",
    "prepare_s": 0.5,
    "draw_s": 2,
    "licence": "CC-BY-4.0",
    "export": "0123456789abcdef" * 4,
}
KEYS = "name, source, trained_on, hardware, prepare_s, draw_s, licence, export, version"


def toml_of(**changes) -> str:
    values = {key: value for key, value in (STATED | changes).items() if value is not None}
    return "".join(f"{key} = {json.dumps(value)}\n" for key, value in values.items())


EXPORT = STATED["export"]
VIEWS = (View(0.0, 10.0), View(90.0, -10.0))
PIXELS = np.random.default_rng(0).integers(0, 256, (2, 128, 128, 3), np.uint8)
POINTS = np.zeros((3, 3), np.float32)


def exported(name: str) -> ExportedObject:
    images = tuple((view, StoredFile(Path("none"), "")) for view in VIEWS)
    return ExportedObject("chair", name, None, (), images)


OBJECTS = (exported("a"), exported("b"))


@pytest.fixture
def tree(tmp_path) -> Path:
    """Two images of each of two objects at one condition."""
    root = tmp_path / "tree"
    for obj in OBJECTS:
        folder = root / "2048/chair" / obj.object_id
        folder.mkdir(parents=True)
        for view, pixels in enumerate(PIXELS):
            Image.fromarray(pixels).save(folder / f"{view:02d}.png")
    (root / "method.toml").write_text(toml_of())
    return root


def images_of(root: Path) -> ImageTree:
    images = entered_method(root, ()).images
    assert images is not None
    return images


def check(root: Path, export=EXPORT, conditions=("2048",), objects=OBJECTS, views=2) -> None:
    images_of(root).check("exported:x", export, objects, conditions, views)


def problem(root: Path, **arguments) -> str:
    return refusal(partial(check, root, **arguments)).replace(str(root), "TREE")


def drawn(root: Path, views=VIEWS, name="a", condition="2048"):
    renderer = images_of(root)
    origin = CloudOrigin(condition, "chair", name, VIEWS)
    return renderer.draw(renderer.prepare(PointCloud(POINTS, origin=origin)), views)


def test_a_method_has_the_facts_of_its_author(tree):
    method = find_run_method(f"images:{tree}")
    assert (method.id, method.address) == ("neural-points", f"images:{tree}")
    assert (method.trained_on, method.role, method.kind) == ("ShapeNet cars", "", "")
    assert method.source == (
        "a network over points, arXiv:0000.00000; entered by images, drawn elsewhere on one H100, "
        "its times are claimed; licence of the images: CC-BY-4.0"
    )
    assert find_run_method("splat") == find_method("splat")
    (tree / "method.toml").write_text(toml_of(name="pc2pix"))
    with pytest.raises(BadInput, match="name 'pc2pix' is an id of this installation"):
        find_run_method(f"images:{tree}")
    with pytest.raises(BadInput, match="cannot draw other clouds; give them to 'bench run' of"):
        find_method(f"images:{tree}")


def test_images_are_returned_to_the_last_bit(tree):
    check(tree)
    np.testing.assert_array_equal(drawn(tree), PIXELS.astype(np.float32) / np.float32(255))
    np.testing.assert_array_equal(drawn(tree, VIEWS[1:]), drawn(tree)[1:])
    np.testing.assert_array_equal(drawn(tree, VIEWS[::-1]), drawn(tree)[::-1])


def test_a_missing_image_is_a_failure_with_its_place(tree):
    (tree / "2048/chair/a/01.png").unlink()
    check(tree)
    assert len(drawn(tree, VIEWS[:1])) == 1
    with pytest.raises(StageFailure, match=r"^images: no image at 2048/chair/a/01\.png$"):
        drawn(tree)
    with pytest.raises(StageFailure, match=r"^images: no image at 512/chair/a/00\.png$"):
        drawn(tree, condition="512")
    with pytest.raises(StageFailure, match="the cloud is not one of a run on an export"):
        images_of(tree).prepare(PointCloud(POINTS))


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"export": None}, "images:TREE: has images of an export, and exported:x is none; give "),
        (
            {"export": "f" * 64},
            "TREE/method.toml: export 0123456789ab... is not that of exported:x (ffffffffffff...)",
        ),
        ({"conditions": ("512",)}, "TREE: no image for this run: nothing at CONDITION/CLASS/OBJEC"),
        ({"objects": (exported("../../../etc"),)}, "'2048/chair/../../../etc': leads out of a tr"),
        ({}, "TREE/2048/chair/b/01.png: 64 x 64 pixels, expected 128 x 128; draw it in that size"),
    ],
)
def test_a_tree_that_a_run_cannot_use_is_refused_before_it(tree, arguments, says):
    Image.new("RGB", (64, 64)).save(tree / "2048/chair/b/01.png")
    check(tree, views=1)  # which does not use it
    assert problem(tree, **arguments).startswith(says)


def test_links_that_lead_out_of_the_tree_are_refused(tree, tmp_path):
    folder, outside = tree / "2048/chair/a", tmp_path / "outside"
    (folder / "01.png").unlink()
    (folder / "01.png").symlink_to("00.png")  # within the tree
    check(tree)
    np.testing.assert_array_equal(*drawn(tree))
    shutil.move(folder, outside)
    folder.symlink_to(outside)
    assert problem(tree).startswith(
        f"TREE/2048/chair/a/00.png: leads out of the tree, to {outside}/00.png; copy the file into"
    )
    with pytest.raises(BadInput, match="leads out of the tree"):
        drawn(tree)
    folder.unlink()
    folder.mkdir()
    os.mkfifo(folder / "00.png")
    assert "00.png: no regular file but a pipe or device" in problem(tree)


def test_what_a_run_does_not_read_is_named(tree):
    images = images_of(tree)
    assert images.unused(OBJECTS, ["2048"]) == ""
    assert images.unused(OBJECTS[:1], ["2048"]) == (
        f"neural-points: the run has no use for '2048/chair/b' in {tree}"
    )
    np.savez(tree / "2048/chair/c.npz", images=PIXELS)
    for name in ("2048/sofa/a", "512/chair/a"):
        (tree / name).mkdir(parents=True)
    assert images.unused(OBJECTS[:1], ["2048"]) == (
        "neural-points: the run has no use for '2048/chair/b', '2048/chair/c.npz', '2048/sofa' and "
        f"1 more in {tree}"
    )


def test_the_checksum_is_that_of_the_images_of_one_cloud(tree):
    images = images_of(tree)
    before = [images.checksum("2048", obj, 2) for obj in OBJECTS]
    Image.fromarray(PIXELS[1]).save(tree / "2048/chair/a/00.png")
    after = [images.checksum("2048", obj, 2) for obj in OBJECTS]
    assert after[0] != before[0]
    assert after[1] == before[1]
    (tree / "2048/chair/a/01.png").unlink()
    assert images.checksum("2048", OBJECTS[0], 2) not in (before[0], after[0])
    assert images.checksum("2048", OBJECTS[1], 1) != before[1]


def test_the_facts_are_read(tmp_path):
    (tmp_path / "method.toml").write_text(toml_of())
    claims = read_claims(tmp_path, {"splat"})
    assert claims == Claims(**STATED)
    assert claims.version == ""
    (tmp_path / "method.toml").write_text(toml_of(version="1.2"))
    assert read_claims(tmp_path, ()).version == "1.2"


def time_of(number):
    return toml_of(draw_s=None) + f"draw_s = {number}\n"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (toml_of(name=None), "no key name; add it, as docs/extending.md shows"),
        (toml_of(export=None), "no key export; add it, as docs/extending.md shows"),
        (toml_of(speed=1), f"unknown key 'speed'; the keys are {KEYS}"),
        (toml_of(name="Neural_Points"), "name 'Neural_Points' is not kebab-case (a-z, 0-9 and sin"),
        (
            toml_of(name="../up"),
            "name '../up' is not kebab-case (a-z, 0-9 and single hyphens), and",
        ),
        (toml_of(name="splat"), "name 'splat' is an id of this installation; give another name"),
        (toml_of(source=""), "source '' has 0 characters, not 1..200; give a short text in one li"),
        (toml_of(source="a\nb"), "source \"'a\\\\nb'\" has characters that cannot be seen; give a"),
        (toml_of(hardware=["H100"]), "hardware \"['H100']\" is not a text; give a short text in "),
        (
            toml_of(draw_s=-1),
            "draw_s '-1' is no number of seconds from 0 to 1e+06; give the time as",
        ),
        (
            toml_of(draw_s="2"),
            "draw_s \"'2'\" is no number of seconds from 0 to 1e+06; give the time as",
        ),
        (toml_of(export="abc"), "export 'abc' is no sha256; copy the identifier in the croissant"),
        (time_of("nan"), "draw_s 'nan' is no number of seconds"),
        (time_of("inf"), "draw_s 'inf' is no number of seconds"),
        (time_of("true"), "draw_s 'True' is no number of seconds"),
        (time_of("9" * 400), f"draw_s '{'9' * 40}"),
        ("name = ", "not TOML (Invalid value"),
        ("x = " + "[" * 50_000, "not TOML ("),
        ("draw_s = " + "9" * 5_000, "not TOML ("),
        ("#" * 70_000, "70000 bytes, and at most 65536 are read; give a smaller file"),
        (None, "no such file"),
    ],
    ids=lambda value: str(value)[-20:],
)
def test_a_wrong_fact_is_named(tmp_path, text, expected):
    path = tmp_path / "method.toml"
    if text is not None:
        path.write_text(text)
    assert refusal(read_claims, tmp_path, {"splat"}).startswith(f"{path}: {expected}")


def test_a_manifest_has_the_facts_and_the_place(tmp_path):
    claims = Claims(**STATED)
    manifest = manifest_entry({"neural-points": (tmp_path, claims)})
    assert entered_claims(manifest, "neural-points") == claims
    assert address_of(manifest, "neural-points") == f"images:{tmp_path}"
    assert entered_claims(manifest, "splat") is None
    assert address_of(manifest, "splat") == "splat"
    assert manifest_entry({}) == {}


def test_a_damaged_entry_of_a_manifest_is_as_none():
    for entered in (None, [], {"neural-points": 1}, {"neural-points": {"x": 1}}):
        manifest = {"entered": entered}
        assert entered_claims(manifest, "neural-points") is None
        assert address_of(manifest, "neural-points") == "neural-points"
