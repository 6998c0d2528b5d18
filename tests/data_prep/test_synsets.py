from __future__ import annotations

from data_prep.shapes.catalogue import CLASSES
from data_prep.synsets import CLASS_OF, SYNSETS, class_names


def test_thirteen_classes_and_synsets() -> None:
    assert len(SYNSETS) == len(CLASS_OF) == 13
    assert all(len(synset) == 8 and synset.isdecimal() for synset in CLASS_OF)
    assert set(CLASSES) == set(SYNSETS)


def test_names_of_classes() -> None:
    names = class_names(
        {
            "03001627": "whatever",
            "02747177": "ashcan,trash can",
            "02773838": "",
            "00000001": "chair,electric chair",
            "00000002": "twin",
            "00000003": "twin,other",
        }
    )
    assert names == {
        "03001627": "chair",
        "02747177": "ashcan",
        "02773838": "02773838",
        "00000001": "00000001",  # not the chair of the 13
        "00000002": "twin",
        "00000003": "00000003",
    }
