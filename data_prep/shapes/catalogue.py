"""The classes of the procedural set: the thirteen of the paper's Table 5."""

from __future__ import annotations

from data_prep.shapes import chairs

CLASSES = {shape_class.name: shape_class for shape_class in (chairs.CLASS,)}
