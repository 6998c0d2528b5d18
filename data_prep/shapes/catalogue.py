"""The classes of the procedural set: the thirteen of the paper's Table 5."""

from __future__ import annotations

from data_prep.shapes import (
    airplanes,
    cabinets,
    cars,
    chairs,
    displays,
    lamps,
    loudspeakers,
    rifles,
    sitting_benches,
    sofas,
    tables,
    telephones,
    vessels,
)

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
