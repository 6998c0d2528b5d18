from __future__ import annotations

import numpy as np

from data_prep.datasets.grey import GreyObject
from data_prep.datasets.procedural import ProceduralObject
from data_prep.scene import NEUTRAL_GREY

CHAIR = ProceduralObject("chair", "test", 3)
VIEW_SEED, CLOUD_SEED = 1, 2


def test_all_but_the_colours_is_the_original() -> None:
    grey = GreyObject(CHAIR)
    assert (grey.class_name, grey.object_id, grey.has_truth) == ("chair", "test-0003", True)
    assert grey.fingerprint() == f"unpainted {CHAIR.fingerprint()}"
    one, other = CHAIR.load(), grey.load()
    np.testing.assert_array_equal(other.vertices, one.vertices)
    np.testing.assert_array_equal(other.faces, one.faces)
    assert (other.face_colors == NEUTRAL_GREY).all()
    assert (one.face_colors != other.face_colors).any()
    views, clouds = (
        [getattr(obj, what)(*rest, np.random.default_rng(seed)) for obj in (CHAIR, grey)]
        for what, rest, seed in (("views", (5,), VIEW_SEED), ("cloud", (), CLOUD_SEED))
    )
    assert views[0] == views[1]
    assert clouds[0].points.tobytes() == clouds[1].points.tobytes()


def test_true_images_differ_in_colour_only() -> None:
    views = CHAIR.views(2, np.random.default_rng(VIEW_SEED))
    colour, grey = CHAIR.truth(views), GreyObject(CHAIR).truth(views)
    assert (grey == grey[..., :1]).all()
    assert (colour != colour[..., :1]).any()
    np.testing.assert_array_equal((grey < 255).any(axis=-1), (colour < 255).any(axis=-1))
