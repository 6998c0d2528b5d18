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

from bench.catalogue.images import (
    Claims,
    ImageTree,
    address_of,
    entered_claims,
    entered_method,
    manifest_entry,
    read_claims,
)
from bench.catalogue.methods import find_method, find_run_method
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


def test_a_tree_of_other_clouds_is_refused(tree):
    assert problem(tree, export=None) == (
        "images:TREE: has images of an export, and exported:x is none; score them by "
        "'bench run --dataset exported:PATH' of the export that they were drawn from"
    )
    assert problem(tree, export="f" * 64) == (
        "TREE/method.toml: export 0123456789ab... is not that of exported:x (ffffffffffff...): the "
        "images are of other clouds or views; draw those of this export"
    )
    assert problem(tree, conditions=("512",)) == (
        "TREE: no image for this run: nothing at CONDITION/CLASS/OBJECT/VIEW.png under 512; write "
        "them there, as docs/entering.md shows"
    )


def test_files_that_cannot_be_used_are_refused_before_the_run(tree):
    bad = tree / "2048/chair/b/01.png"
    Image.new("RGB", (64, 64)).save(bad)
    assert problem(tree).startswith("TREE/2048/chair/b/01.png: 64 x 64 pixels, expected 128 x 128")
    check(tree, views=1)  # which does not use it


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


def test_an_object_whose_name_leads_out_of_the_tree_is_refused(tree):
    outside = (exported("../../../etc"),)
    assert problem(tree, objects=outside) == (
        "'2048/chair/../../../etc': leads out of a tree; export it by another name"
    )


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


def problem_of_facts(tmp_path, text: str) -> str:
    path = tmp_path / "method.toml"
    path.write_text(text)
    said = refusal(read_claims, tmp_path, {"splat"})
    assert said.startswith(f"{path}: ")
    return said.removeprefix(f"{path}: ")


def test_the_facts_are_read(tmp_path):
    (tmp_path / "method.toml").write_text(toml_of())
    claims = read_claims(tmp_path, {"splat"})
    assert claims == Claims(**STATED)
    assert claims.version == ""
    (tmp_path / "method.toml").write_text(toml_of(version="1.2"))
    assert read_claims(tmp_path, ()).version == "1.2"


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"name": None}, "no key name; add it, as docs/entering.md shows"),
        ({"export": None}, "no key export; add it, as docs/entering.md shows"),
        ({"speed": 1}, f"unknown key 'speed'; the keys are {KEYS}"),
        ({"name": "Neural_Points"}, "name 'Neural_Points' is not kebab-case (a-z, 0-9 and single"),
        ({"name": "../up"}, "name '../up' is not kebab-case (a-z, 0-9 and single hyphens), and"),
        ({"name": "splat"}, "name 'splat' is an id of this installation; give another name"),
        ({"source": ""}, "source '' has 0 characters, not 1..200; give a short text in one line"),
        ({"source": "a\nb"}, "source \"'a\\\\nb'\" has characters that cannot be seen; give a"),
        ({"hardware": ["H100"]}, "hardware \"['H100']\" is not a text; give a short text in one"),
        ({"draw_s": -1}, "draw_s '-1' is no number of seconds from 0 to 1e+06; give one"),
        ({"draw_s": "2"}, "draw_s \"'2'\" is no number of seconds from 0 to 1e+06; give one"),
        ({"export": "abc"}, "export 'abc' is no sha256; copy the identifier in the croissant.json"),
    ],
    ids=lambda value: str(value)[:30],
)
def test_a_wrong_fact_is_named(tmp_path, changes, expected):
    assert problem_of_facts(tmp_path, toml_of(**changes)).startswith(expected)


@pytest.mark.parametrize("number", ["nan", "inf", "true", "9" * 400])
def test_a_time_is_a_finite_number(tmp_path, number):
    text = toml_of(draw_s=None) + f"draw_s = {number}\n"
    named = number.capitalize() if number == "true" else number
    assert problem_of_facts(tmp_path, text).startswith(f"draw_s '{named[:40]}")
    assert " is no number of seconds" in problem_of_facts(tmp_path, text)


def test_a_file_that_is_none_is_named(tmp_path):
    assert problem_of_facts(tmp_path, "name = ").startswith("not TOML (Invalid value")
    assert problem_of_facts(tmp_path, "x = " + "[" * 50_000).startswith("not TOML (")
    assert problem_of_facts(tmp_path, "draw_s = " + "9" * 5_000).startswith("not TOML (")
    assert problem_of_facts(tmp_path, "#" * 70_000).endswith("give a smaller file")
    (tmp_path / "method.toml").unlink()
    with pytest.raises(BadInput, match=r"method\.toml: no such file$"):
        read_claims(tmp_path, ())
    with pytest.raises(BadInput, match=r"absent: no such folder; give a tree of images with its"):
        read_claims(tmp_path / "absent", ())


def test_a_manifest_has_the_facts_and_the_place(tmp_path):
    claims = Claims(**STATED)
    manifest = manifest_entry({"neural-points": (tmp_path, claims)})
    assert entered_claims(manifest, "neural-points") == claims
    assert address_of(manifest, "neural-points") == f"images:{tmp_path}"
    assert entered_claims(manifest, "splat") is None
    assert address_of(manifest, "splat") == "splat"
    assert manifest_entry({}) == {}


@pytest.mark.parametrize("entered", [None, [], {"neural-points": 1}, {"neural-points": {"x": 1}}])
def test_a_damaged_entry_of_a_manifest_is_as_none(entered):
    manifest = {"entered": entered}
    assert entered_claims(manifest, "neural-points") is None
    assert address_of(manifest, "neural-points") == "neural-points"
