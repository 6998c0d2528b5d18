from __future__ import annotations

from data_prep.datasets.synsets import CLASS_OF, SYNSETS, class_names
from data_prep.shapes.catalogue import CLASSES


def test_thirteen_classes_and_synsets() -> None:
    assert len(SYNSETS) == len(CLASS_OF) == 13
    assert all(len(synset) == 8 and synset.isdecimal() for synset in CLASS_OF)
    assert set(CLASSES) == set(SYNSETS)


def test_names_of_classes() -> None:
    given_and_expected = {
        "03001627": ("whatever", "chair"),
        "02747177": ("ashcan,trash can", "ashcan"),
        "02773838": ("", "02773838"),
        "00000001": ("chair,electric chair", "00000001"),  # not the chair of the 13
        "00000002": ("twin", "twin"),
        "00000003": ("twin,other", "00000003"),
    }
    names = class_names({synset: given for synset, (given, _) in given_and_expected.items()})
    assert names == {synset: expected for synset, (_, expected) in given_and_expected.items()}
