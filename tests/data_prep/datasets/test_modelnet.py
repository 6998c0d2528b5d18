from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from data_prep.clouds.orientations import MODELNET, OURS
from data_prep.datasets.registry import open_dataset
from data_prep.failures import BadInput
from tests.data_prep.dataset_trees import write_off


def names(dataset, class_name: str, split=None) -> list[str]:
    return [obj.object_id for obj in dataset.objects(class_name, None, 0, split)]


def test_folders_of_splits(tmp_path: Path) -> None:
    chairs = ("train/chair_0001", "train/chair_0002", "test/chair_0890", "chair_0003")
    desks = ("desk/train/desk_0001", "desk/test/desk_0001")
    stands = ("night_stand/test/night_stand_0201",)
    for name in (*(f"chair/{chair}" for chair in chairs), *desks, *stands):
        write_off(tmp_path / f"{name}.off", MODELNET)
    (tmp_path / "chair" / "test" / ".DS_Store").touch()
    dataset = open_dataset(f"modelnet:{tmp_path}")
    assert dataset.classes == ("chair", "desk", "night_stand")
    assert names(dataset, "chair") == ["chair_0890"]
    assert names(dataset, "chair", "train") == ["chair_0001", "chair_0002"]
    assert names(dataset, "night_stand") == ["night_stand_0201"]
    assert dataset.irregular == (
        "chair: 1 files beside train and test are left out",
        "desk: 1 ids are in train and in test",
    )


def test_folders_of_splits_in_capitals(tmp_path: Path) -> None:
    for name in ("Train/chair_0001", "train/chair_0002", "TEST/chair_0890"):
        write_off(tmp_path / "chair" / f"{name}.off", MODELNET)
    dataset = open_dataset(f"modelnet:{tmp_path}")
    assert names(dataset, "chair") == ["chair_0890"]
    assert names(dataset, "chair", "train") == ["chair_0001", "chair_0002"]
    assert dataset.irregular == ()


def test_split_lists(tmp_path: Path) -> None:
    for name in ("chair_0001", "chair_0002", "chair_0003", "night_stand_0001"):
        write_off(tmp_path / name.rpartition("_")[0] / f"{name}.off", MODELNET)
    (tmp_path / "modelnet40_shape_names.txt").write_text("chair\nnight_stand\n")
    (tmp_path / "ModelNet40_Train.txt").write_text("chair_0002\r\nnight_stand_0001\r\n")
    (tmp_path / "modelnet40_test.txt").write_text("chair_0001\nchair_0002\nchair_0009\nsofa_0001\n")
    (tmp_path / "modelnet10_test.txt").write_text("chair_0003\n")  # a part of the 40
    dataset = open_dataset(f"modelnet:{tmp_path}")
    assert names(dataset, "chair") == ["chair_0001", "chair_0009"]
    assert names(dataset, "chair", "train") == ["chair_0002"]
    assert names(dataset, "night_stand", "train") == ["night_stand_0001"]
    assert dataset.irregular == (
        "modelnet40_test.txt: chair_0002 is listed again and left out",
        "chair: 1 of the split 'test' are not there: chair_0009",
        "chair: 1 are in no split and left out: chair_0003",
    )
    with pytest.raises(BadInput, match="no such file"):
        dataset.objects("chair", None, 0)[1].load()


def test_turned_upright_with_the_glued_header(tmp_path: Path) -> None:
    write_off(tmp_path / "chair" / "train" / "chair_0001.off", MODELNET, glued=True)
    write_off(tmp_path / "straight" / "chair" / "a.off", OURS)
    (obj,) = open_dataset(f"modelnet:{tmp_path}").objects("chair", None, 0, "train")
    (straight,) = open_dataset(f"folder:{tmp_path / 'straight'}").finite
    assert (tmp_path / "chair/train/chair_0001.off").read_text().startswith("OFF24 36 0\n")
    for part in ("vertices", "faces", "face_colors"):
        assert np.array_equal(getattr(obj.load(), part), getattr(straight.load(), part))
