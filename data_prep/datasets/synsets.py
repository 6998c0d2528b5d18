"""The 13 classes of the paper and the WordNet synsets by which ShapeNet calls them."""

from __future__ import annotations

from collections.abc import Mapping

SYNSETS: Mapping[str, str] = {
    "airplane": "02691156",
    "bench": "02828884",
    "cabinet": "02933112",
    "car": "02958343",
    "chair": "03001627",
    "display": "03211117",
    "lamp": "03636649",
    "loudspeaker": "03691459",
    "rifle": "04090263",
    "sofa": "04256520",
    "table": "04379243",
    "telephone": "04401088",
    "vessel": "04530566",
}
CLASS_OF: Mapping[str, str] = {synset: name for name, synset in SYNSETS.items()}


def class_names(synsets: Mapping[str, str]) -> dict[str, str]:
    """Return the class of each synset: one of the 13, else the first of its names in `synsets`.

    The names are those of ShapeNet ("display,video display"). A synset without a name, or whose
    name another class has, keeps its number.
    """
    names: dict[str, str] = {s: CLASS_OF[s] for s in synsets if s in CLASS_OF}
    taken = set(SYNSETS)
    for synset, given in sorted(synsets.items()):
        if synset not in names:
            name = given.split(",")[0].strip()
            names[synset] = name if name and name not in taken else synset
            taken.add(names[synset])
    return names
