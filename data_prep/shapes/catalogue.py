"""The classes of the procedural set: the thirteen of the paper's Table 5."""

from __future__ import annotations

from data_prep.shapes import (
    airplanes,
    lamps,
    loudspeakers,
    rifles,
    sitting_benches,
    sofas,
    telephones,
    vessels,
)
from data_prep.shapes.cabinet import cabinets
from data_prep.shapes.car import cars
from data_prep.shapes.chair import chairs
from data_prep.shapes.display import displays
from data_prep.shapes.table import tables

CLASSES = {
    shape_class.name: shape_class
    for shape_class in (
        airplanes.CLASS,
        sitting_benches.CLASS,
        cabinets.CLASS,
        cars.CLASS,
        chairs.CLASS,
        displays.CLASS,
        lamps.CLASS,
        loudspeakers.CLASS,
        rifles.CLASS,
        sofas.CLASS,
        tables.CLASS,
        telephones.CLASS,
        vessels.CLASS,
    )
}
