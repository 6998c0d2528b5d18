"""The classes of the procedural set, the thirteen of the paper's Table 5, and their families.

A family has a weight, which says how often it is drawn, and a builder. The order of the families
decides which of them a random number chooses. Novel families are of the split of that name alone.
"""

from __future__ import annotations

from functools import partial

from data_prep.shapes.airplane import airliners, military, propeller
from data_prep.shapes.cabinet import cabinets, kitchens
from data_prep.shapes.car import cars
from data_prep.shapes.chair import chairs, novel
from data_prep.shapes.chair.spec import FAMILY_WEIGHTS
from data_prep.shapes.display import displays, tubes
from data_prep.shapes.lamp import hung, standing, street
from data_prep.shapes.loudspeaker import living_room, small, stage
from data_prep.shapes.rifle import automatic, long_guns
from data_prep.shapes.shape_class import Builder, shape_class
from data_prep.shapes.sitting_bench import indoor, outdoor
from data_prep.shapes.sofa import bodies, frames
from data_prep.shapes.table import desks, tables
from data_prep.shapes.telephone import fixed, mobile
from data_prep.shapes.vessel import boats, merchant, sailing, warships

FAMILIES: dict[str, dict[str, tuple[float, Builder]]] = {
    "airplane": {
        "airliner": (0.40, airliners.airliner),
        "rear-engine-jet": (0.14, airliners.rear_engine_jet),
        "fighter": (0.20, military.fighter),
        "propeller": (0.13, propeller.propeller_plane),
        "biplane": (0.05, propeller.biplane),
        "supersonic": (0.04, airliners.supersonic),
        "flying-wing": (0.04, military.flying_wing),
    },
    "bench": {
        "park": (0.30, outdoor.park),
        "settle": (0.20, indoor.settle),
        "plank": (0.20, outdoor.plank),
        "pew": (0.11, indoor.pew),
        "picnic": (0.08, outdoor.picnic),
        "row": (0.11, indoor.row),
    },
    "cabinet": {
        "chest": (0.28, cabinets.chest),
        "sideboard": (0.18, cabinets.sideboard),
        "wardrobe": (0.18, cabinets.wardrobe),
        "shelves": (0.18, cabinets.shelving),
        "hutch": (0.08, cabinets.hutch),
        "kitchen": (0.10, kitchens.kitchen),
    },
    "car": {
        "sedan": (0.30, partial(cars.closed, family="sedan")),
        "coupe": (0.22, partial(cars.closed, family="coupe")),
        "suv": (0.15, partial(cars.closed, family="suv")),
        "hatchback": (0.12, partial(cars.closed, family="hatchback")),
        "van": (0.08, cars.van),
        "pickup": (0.07, cars.pickup),
        "convertible": (0.06, cars.convertible),
    },
    "chair": {
        family: (weight, partial(chairs.chair_of, family=family))
        for family, weight in FAMILY_WEIGHTS.items()
    },
    "display": {
        "monitor": (0.35, displays.monitor),
        "television": (0.23, displays.television),
        "tube-monitor": (0.13, tubes.tube_monitor),
        "old-television": (0.08, tubes.old_television),
        "all-in-one": (0.09, displays.all_in_one),
        "pair": (0.06, displays.monitor_pair),
        "sign": (0.06, displays.sign),
    },
    "lamp": {
        "bedside": (0.24, standing.bedside),
        "floor": (0.18, standing.floor),
        "pendant": (0.17, hung.pendant),
        "desk": (0.14, standing.desk),
        "chandelier": (0.11, hung.chandelier),
        "post": (0.09, street.lamp_post),
        "sconce": (0.07, hung.sconce),
    },
    "loudspeaker": {
        "bookshelf": (0.30, living_room.bookshelf),
        "tower": (0.26, living_room.tower),
        "stand": (0.10, living_room.stand),
        "stage": (0.13, stage.stage),
        "desktop": (0.08, small.desktop),
        "cylinder": (0.07, small.cylinder),
        "soundbar": (0.06, small.soundbar),
    },
    "rifle": {
        "assault": (0.30, automatic.assault),
        "bolt-action": (0.18, long_guns.bolt_action),
        "sniper": (0.14, long_guns.sniper),
        "shotgun": (0.13, long_guns.shotgun),
        "submachine": (0.11, automatic.submachine),
        "machine-gun": (0.07, automatic.machine_gun),
        "bullpup": (0.07, automatic.bullpup),
    },
    "sofa": {
        "box-arm": (0.40, bodies.box_arm),
        "rolled-arm": (0.17, bodies.rolled_arm),
        "sectional": (0.15, bodies.sectional),
        "open-frame": (0.11, frames.open_frame),
        "armless": (0.08, frames.armless),
        "curved": (0.09, frames.curved),
    },
    "table": {
        "four-leg": (0.36, tables.four_leg),
        "pedestal": (0.16, tables.pedestal),
        "desk": (0.16, desks.desk),
        "panel": (0.12, desks.panel_table),
        "frame": (0.11, tables.metal_frame),
        "trestle": (0.09, tables.trestle),
    },
    "telephone": {
        "smartphone": (0.34, mobile.smartphone),
        "keypad": (0.22, mobile.keypad_phone),
        "flip": (0.13, mobile.flip),
        "cordless": (0.10, fixed.cordless),
        "desk": (0.14, fixed.desk),
        "classic": (0.07, fixed.classic),
    },
    "vessel": {
        "cargo-ship": (0.22, merchant.cargo_ship),
        "warship": (0.20, warships.warship),
        "sailing-yacht": (0.15, sailing.sailing_yacht),
        "motor-yacht": (0.13, boats.motor_yacht),
        "passenger-ship": (0.10, merchant.passenger_ship),
        "tall-ship": (0.08, sailing.tall_ship),
        "open-boat": (0.07, boats.open_boat),
        "submarine": (0.05, warships.submarine),
    },
}
NOVEL_FAMILIES: dict[str, dict[str, tuple[float, Builder]]] = {"chair": novel.FAMILIES}
CLASSES = {name: shape_class(name, families) for name, families in FAMILIES.items()}
NOVEL_CLASSES = {name: shape_class(name, families) for name, families in NOVEL_FAMILIES.items()}
