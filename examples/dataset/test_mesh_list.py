"""The dataset reads the meshes of its sample."""

from pathlib import Path

from mesh_list import DATASET


def test_the_sample_is_read():
    """The sample has a cube for tests and a tall box for training."""
    dataset = DATASET.read("mesh-list:sample", Path(__file__).parent / "sample")
    assert [obj.object_id for obj in dataset.objects("chair", None, 10)] == ["cube.ply"]
    assert sorted(dataset.splits) == ["test", "train"]
