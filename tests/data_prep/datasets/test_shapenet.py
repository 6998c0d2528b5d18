from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from data_prep.clouds.orientations import OURS, SHAPENET_V1, SHAPENET_V2
from data_prep.datasets.registry import open_dataset
from data_prep.failures import BadInput
from data_prep.rendering.opengl import render
from data_prep.scene import View
from tests.data_prep.dataset_trees import shape, write_obj, write_ply

CHAIR, TABLE, ASHCAN = "03001627", "04379243", "02747177"
VIEWS = [View(0, 0), View(90, 0), View(-35, 25)]
A = "1a6f615e8b1b5ae4dbbc9440457e303e"


def v1(root: Path, synset: str, name: str) -> Path:
    """ShapeNetCore.v1 is within a unit cube, about the origin."""
    path = root / synset / name / "model.obj"
    write_obj(path, SHAPENET_V1, scale=0.5)
    return path


def v2(root: Path, synset: str, name: str) -> Path:
    """ShapeNetCore.v2 has another scale, and its centre somewhere else."""
    path = root / synset / name / "models" / "model_normalized.obj"
    write_obj(path, SHAPENET_V2, scale=0.25, offset=(0.125, 0.0, -0.25))
    return path


def names(dataset, class_name: str, split=None) -> list[str]:
    return [obj.object_id for obj in dataset.objects(class_name, None, 0, split)]


@pytest.mark.opengl
def test_both_versions_give_the_same_image(tmp_path: Path) -> None:
    v1(tmp_path / "1", CHAIR, A)
    v2(tmp_path / "2", CHAIR, A)
    write_ply(tmp_path / "3" / "chair" / "a.ply", OURS)
    objects = [
        open_dataset(spec).finite[0]
        for spec in (f"shapenet:{tmp_path}/1", f"shapenet:{tmp_path}/2", f"folder:{tmp_path}/3")
    ]
    meshes = [obj.load() for obj in objects]
    # Coordinates are rounded to float32 when the file has been read, once more when normalised:
    # within [-1, 1] that is 2**-25 each, on a shape enlarged by less than 8 on its way.
    np.testing.assert_allclose(meshes[1].vertices, meshes[0].vertices, atol=9 * 2.0**-25)
    images = [render(mesh, VIEWS) for mesh in meshes]
    assert np.array_equal(images[0], images[1])
    assert np.array_equal(images[0], images[2])
    # The post stands at the front on the right of the object: for who looks at it, on the left.
    green = (images[0][0].astype(int) @ [-1, 2, -1]) > 60
    assert green.any()
    assert np.argwhere(green)[:, 1].max() < 64


def test_classes_and_materials(tmp_path: Path) -> None:
    v2(tmp_path, CHAIR, A)
    v2(tmp_path, TABLE, "b")
    v2(tmp_path, ASHCAN, "c")
    v2(tmp_path, "02773838", "d")
    v2(tmp_path, "not-a-synset", "e")
    entries = [{"synsetId": ASHCAN, "name": "ashcan,trash can", "children": [], "numInstances": 1}]
    (tmp_path / "taxonomy.json").write_text(json.dumps(entries))
    dataset = open_dataset(f"shapenet:{tmp_path}")
    assert dataset.classes == ("02773838", "ashcan", "chair", "table")
    assert names(dataset, "chair") == [A]
    assert names(dataset, "chair", "train") == [A]  # no splits
    mesh = dataset.objects("ashcan", None, 0)[0].load()
    found, expected = (
        np.unique(c, axis=0, return_counts=True) for c in (mesh.face_colors, shape()[2])
    )
    assert np.array_equal(found[0], expected[0])
    assert np.array_equal(found[1], expected[1])


def test_textures_lie_beside_the_folder_of_the_mesh(tmp_path: Path) -> None:
    path = v2(tmp_path, CHAIR, A)
    text = path.read_text().replace("mtllib", "vt 0.5 0.5\nmtllib")
    path.write_text(re.sub(r"^f (\d+) (\d+) (\d+)$", r"f \1/1 \2/1 \3/1", text, flags=re.M))
    path.with_suffix(".mtl").write_text(
        "".join(f"newmtl m{i}\nmap_Kd ../images/t.png\n" for i in range(3))
    )
    images = path.parents[1] / "images"
    images.mkdir()
    Image.new("RGB", (4, 4), (10, 200, 30)).save(images / "t.png")
    (obj,) = open_dataset(f"shapenet:{tmp_path}").finite
    assert np.unique(obj.load().face_colors, axis=0).tolist() == [[10, 200, 30]]
    before = obj.fingerprint()
    Image.new("RGB", (4, 4), (200, 10, 30)).save(images / "t.png")
    assert obj.fingerprint() != before
    # Nothing above the folder of the object is read.
    Image.new("RGB", (4, 4), (1, 2, 3)).save(tmp_path / "outside.png")
    path.with_suffix(".mtl").write_text("newmtl m0\nmap_Kd ../../../outside.png\n")
    assert [1, 2, 3] not in obj.load().face_colors.tolist()


@pytest.mark.parametrize("place", ["core", "."])
def test_splits(tmp_path: Path, place: str) -> None:
    """The list lies in the folder of the dataset, or beside it."""
    lists, tmp_path = tmp_path / place, tmp_path / "core"
    for name in "abcdef":
        v1(tmp_path, CHAIR, name)
    (tmp_path / CHAIR / "hollow").mkdir()
    (lists / "all.csv").write_text(
        "id,synsetId,subSynsetId,modelId,split\r\n"
        f"1,{CHAIR},{CHAIR},c,test\r\n2,{CHAIR},{CHAIR},a,train\r\n3,{CHAIR},{CHAIR},b,val\r\n"
        f"4,{CHAIR},{CHAIR},gone,test\r\n5,{CHAIR},{CHAIR},d,test\r\n"
        f"6,{CHAIR},{CHAIR},c,train\r\n7,{TABLE},{TABLE},t,test\r\n8,0{CHAIR[1:]},x,e,train\r\n"
    )
    dataset = open_dataset(f"shapenet:{tmp_path}")
    assert names(dataset, "chair") == ["c", "gone", "d"]
    assert names(dataset, "chair", "train") == ["a", "e"]
    assert names(dataset, "chair", "validation") == ["b"]
    assert dataset.classes == ("chair",)  # the table's synset is not there
    assert dataset.irregular == (
        "all.csv: 1 models are listed twice, the first counts: c (test, train)",
        "chair: 1 folders without a model: hollow",
        "chair: 1 of the split 'test' are not there: gone",
        "chair: 1 are in no split and left out: f",
    )
    gone = dataset.objects("chair", None, 0)[1]
    with pytest.raises(BadInput, match="no such file"):
        gone.load()


def test_versions_side_by_side_and_shared_ids(tmp_path: Path) -> None:
    v1(tmp_path, CHAIR, "a")
    v2(tmp_path, CHAIR, "ünïcode\n")
    v2(tmp_path, TABLE, "a")
    dataset = open_dataset(f"shapenet:{tmp_path}")
    assert dataset.layout == "ShapeNetCore v1 and v2, without all.csv: one split"
    assert dataset.irregular == (
        "objects of v1 and v2 side by side; each is turned as its own path says",
        "1 ids are in several classes: a (chair, table)",
    )
    assert names(dataset, "chair") == ["a", "ünïcode\n"]
    one, other = (obj.load() for obj in dataset.objects("chair", None, 0))
    np.testing.assert_allclose(one.vertices, other.vertices, atol=9 * 2.0**-25)
