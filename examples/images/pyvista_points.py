"""Draw the clouds of an export with PyVista: python pyvista_points.py EXPORT TREE."""

import csv
import json
import sys
from pathlib import Path

import numpy as np
import pyvista

export, tree = Path(sys.argv[1]), Path(sys.argv[2])
points = {"color": "silver", "point_size": 4, "render_points_as_spheres": True}
window = pyvista.Plotter(off_screen=True, window_size=(128, 128))
window.set_background("white")
for cloud in csv.DictReader((export / "clouds.csv").open()):
    window.add_points(pyvista.read(export / cloud["file"]), name="cloud", **points)
    folder = tree / cloud["condition"] / cloud["class"] / cloud["object"]
    folder.mkdir(parents=True)
    for view in csv.DictReader((export / "views.csv").open()):
        if (view["class"], view["object"]) == (cloud["class"], cloud["object"]):
            a, e = np.radians((float(view["azimuth_deg"]), float(view["elevation_deg"])))
            towards = np.array((np.cos(e) * np.sin(a), np.sin(e), -np.cos(e) * np.cos(a)))
            window.camera_position = [4 * towards, (0, 0, 0), (0, 1, 0)]
            window.camera.view_angle = 30.84
            window.render()
            window.screenshot(folder / f"{int(view['view']):02d}.png")
facts = Path(__file__).with_name("method.toml").read_text()
identifier = json.loads((export / "croissant.json").read_text())["identifier"]
(tree / "method.toml").write_text(f'{facts}export = "{identifier}"\n')
