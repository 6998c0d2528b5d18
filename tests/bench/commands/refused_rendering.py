"""Command lines of `bench render` that are refused, and what their one line says."""

import math

from bench.catalogue.chosen import measured_methods

CHEAPEST_MS = measured_methods()["splat"].one_view_ms
LEAST_MS = f"{math.ceil(10 * CHEAPEST_MS) / 10:g}"  # rounded up, so that it is enough
WRITTEN = "images are written as PNG or JPEG, turntables as GIF or WebP; give a name that"
BOTH = "clouds/a.xyz and other/a.xyz would both be drawn as images/a.png; rename one, or draw "
_CAMERA = {
    "intrinsic": {"width": 2048, "height": 16, "intrinsic_matrix": [9, 0, 0, 0, 9, 0, 8, 8, 1]},
    "extrinsic": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, -50, 1],
}
CAMERAS = {"camera.json": _CAMERA, "cameras.json": {"parameters": [_CAMERA] * 9}}
_BY_START = {
    "render cloud.xyz": {
        "--budget 50ms --method splat": "budget 50ms: it chooses the method, and splat is named",
        "--budget 0.1ms": "budget 0.1ms: the cheapest method is splat "
        f"with {LEAST_MS} ms for one image",
        "--budget 50": "budget 50: give a time over 0 with its unit, as in 50ms or 0.2s",
        "--colour invented --method surface-fit": "method 'surface-fit' draws in grey",
        "--colour invented --budget 50ms": "budget 50ms: the methods that it chooses",
        "--colour file --budget 1s": "cloud.xyz: no colours of its points; a PLY has red, green ",
        "--colour grey --method fused-net": "method 'fused-net' makes colours up; give method fuse",
        "--colour file --method splat,pc2pix": "method 'pc2pix' makes colours up; give method fuse",
    },
    "render cloud.xyz --method blank -o out.png": {
        "--method splta": "unknown method 'splta': did you mean 'splat'? there are ",
        "--method blank,splta": "unknown method 'splta': did you mean 'splat'?",
        "--method ' , '": "' , ': expected names separated by commas",
        "--method true-mesh": "cloud.xyz: method 'true-mesh' draws the mesh behind a cloud, and ",
        "--azimuth inf": "no such view: azimuth_deg must be finite, got inf",
        "--azimuth 0,left": "'0,left': not numbers; give degrees separated by commas, as in",
        "--azimuth 0,90 -o a.gif": "a.gif: a turntable starts at one azimuth; ",
        "--elevation 91": "no such view: elevation_deg must lie in -90..90, got 91.0",
        "--elevation nan": "no such view: elevation_deg must lie in -90..90, got nan",
        "--format bmp": "Invalid value for '--format': 'bmp' is not one of 'png', 'jpg', ",
        "--up w": "up 'w': no axis; give one of x, -x, y, -y, z, -z",
        "--up y --front=+z": "front '+z': no axis; give one of x, -x, y, -y, z, -z",
        "--up z --front=-z": "front '-z': along up, which is 'z'; give one of x, ",
        "--points 0": "--points 0: must be at least 1",
        "--frames 12": "--frames 12: out.png is one image; give a turntable's name, .g",
        "--frames 0 -o turn.gif": "--frames 0: must be 1 to 120",
        "--frames 121 -o turn.gif": "--frames 121: must be 1 to 120",
        "-o meshes": f"meshes: {WRITTEN}",
        "-o out.bmp": f"out.bmp: {WRITTEN} ends in .png, .jpg, .gif or .webp",
        "-o folder.png": "folder.png: is a folder; give the name of a file",
        "-o new/out.png": "new/out.png: no such folder, new; make it, or give another -o",
        "--size 15": "--size 15: must be 16 to 2048",
        "--size 2049": "--size 2049: must be 16 to 2048",
        "--size 640x480": "--size 640x480: images are square, as the unit sphere just fits",
        "--size big": "--size big: not a whole number of pixels; give a number",
        "--size 512px": "--size 512px: not a whole number of pixels; give a number",
        "--size 1000 -o a.gif": "--size 1000: at most 965 with 36 images; give a sm",
        "--size 2048 --azimuth 1,2,3,4,5,6,7,8,9": "--size 2048: at most 1930 with 9 i",
        "--size 2048 --method splat,blank --azimuth 1,2,3": "--size 2048: at most 1930 with 9 i",
        "--background black": "Invalid value for '--background': 'black' is not one of ",
        "--background transparent -o a.gif": "a.gif: a GIF cannot have transparent",
        "--background transparent -o a.jpg": "a.jpg: a JPEG cannot have transparent",
        "--background transparent --method splat,blank": "transparent: a sheet is white; give one",
    },
    "render cloud.xyz --method splat --camera camera.json": {
        "": "cloud.xyz: the camera of camera.json looks away from the cloud; give it in the coord",
        "--azimuth 30": "--azimuth: the file of --camera says where its cameras stand, and how",
        "--size 128": "--size: the file of --camera says where",
        "--frames 1 -o a.webp": "--frames: the file of --camera says where",
        "-o a.gif": "a.gif: cameras give still images; give a name that ends in .png",
        "--as-is": "--as-is: a camera moves with its cloud; leave out --as-is, or --camera",
        "--method splat,blank": "--camera camera.json: a sheet of several methods has its own",
        "--method pc2pix@all": "method 'pc2pix@all' knows a camera by azimuth and elevation alone",
        "--camera cloud.xyz": "cloud.xyz: not JSON; give one of Open3D",
        "--camera cameras.json": "cameras.json: 9 cameras, and at most 8 of 2048 x 16 pixels are ",
    },
    "render": {
        ".": ".: a folder; give a folder for the images, -o FOLDER",
        "gone.ply": "gone.ply: no such file; check its name",
        "gone/gone.ply": "gone/gone.ply: no such file; check its name",
        "'a\nb'": "a\\nb: a name without a suffix is not supported as a cloud or mesh; use one of ",
        "equal.xyz -o out.png": "equal.xyz: all 2 points are equal, at [1.0, 2.0, 3.0]; a ",
        "clouds other -o images": BOTH,
        "cloud.xyz gone.ply -o images": "gone.ply: no such file; check",
        "cloud.xyz a.obj -o images": "a.obj: no such file; check",
        "nothing -o images": "nothing: no clouds or meshes in this folder (it has x); give ",
        "cloud.xyz clouds": "cloud.xyz: one of several clouds; give a folder for the images, -o ",
        "clouds -o x.gif": "x.gif: is the name of one image, for several",
        "clouds -o cloud.xyz": "cloud.xyz: is a file; give a folder for the images",
        "clouds -o new/x": "new/x: no such folder, new",
        "clouds -o images --frames 9": "--frames 9: images/a.png is one image; give a t",
    },
}
RENDERING = {
    f"{start} {words}": problem
    for start, problems in _BY_START.items()
    for words, problem in problems.items()
}
