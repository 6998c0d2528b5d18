"""What commands refuse: a command line, and what its one line says. Nothing is written."""

from __future__ import annotations

import json
import shlex
import shutil
import sqlite3
from contextlib import closing
from dataclasses import replace
from hashlib import sha256

import pytest
import torch
from safetensors.torch import save_file

import bench
from bench.catalogue.methods import ALLOWED
from bench.metrics import inception_weights
from bench.records.folder import set_aside, write_manifest
from bench.records.store import STORE
from bench.running.options import Options
from data_prep.datasets.protocol_version import PROTOCOL_VERSION
from data_prep.failures import BadInput
from data_prep.files.checksums import file_sha256
from learning.weights import FILES as WEIGHTS

from ..builders import make_manifest, write_run
from .refused_rendering import CAMERAS, CHEAPEST_MS, LEAST_MS, RENDERING

OLDER, NEWER = PROTOCOL_VERSION - 1, PROTOCOL_VERSION + 1
OTHER_VERSIONS = (*range(1, PROTOCOL_VERSION), NEWER)
# What stands in place of a version of the protocol, by the name of its files here.
NO_VERSIONS = {"null": None, "true": True, "text": f"'{OLDER}'", "float": float(PROTOCOL_VERSION)}
ROBUSTNESS = "run --suite chair-robustness"
GOLDEN = ("method,condition,class,object,ssim,images", "splat,2048,chair,a,0.5,")
REMAINING = ("splat,512,chair,a", "splat,2048,chair,b", "blank,any,chair,a", "blank,any,chair,b")


def golden_text(lines=GOLDEN, version=PROTOCOL_VERSION, **fields):
    """Return a file of golden values, whose checksum is right whatever it says."""
    fields = {"format": "golden values of pc2pix-bench, 1", "environment": {}, "lines": lines} | {
        "protocol": {"protocol": version},
        **fields,
    }
    packed = json.dumps(fields, sort_keys=True).encode()
    return json.dumps(fields | {"sha256": sha256(packed).hexdigest()})


def export_texts(folder, version):
    """Return the lists of an export of one chair, by the path of the file."""
    chair, stored = "chair,test-0000", "a,0"
    # Exports of protocols before the present one have no matrices of the camera.
    matrix = "" if version in range(1, PROTOCOL_VERSION) else ",camera_to_world"
    return {
        f"{folder}/objects.csv": "class,object,protocol,seed,dataset,file,sha256\n"
        f"{chair},{version},0,procedural,,\n",
        f"{folder}/clouds.csv": "class,object,condition,points,file,sha256\n"
        f"{chair},2048,9,{stored}\n",
        f"{folder}/views.csv": f"class,object,view,azimuth_deg,elevation_deg{matrix},file,sha256\n"
        f"{chair},0,0,0,{matrix[:1]}{stored}\n",
        f"{folder}/croissant.json": '{"distribution": []}',
    }


# What lies in the folder where the command lines are typed: files and their text.
FILES = {
    **{name: json.dumps(camera) for name, camera in CAMERAS.items()},
    "columns.json": golden_text(["a,b", "1,2"]),
    "words.json": golden_text([GOLDEN[0], GOLDEN[1].replace("0.5", "half")]),
    "no-lines.json": golden_text(None),
    "empty-lines.json": golden_text([]),
    "longer-lines.json": golden_text([GOLDEN[0], GOLDEN[1] + ",5"]),
    "quote.json": golden_text(['"', *GOLDEN]),
    "shorter-lines.json": golden_text([GOLDEN[0], GOLDEN[1].rpartition(",")[0]]),
    "twice.json": golden_text([*GOLDEN, GOLDEN[1].replace("0.5", "0.4")]),
    "any.json": golden_text([*GOLDEN, GOLDEN[1].replace("2048", "any")]),
    "broken-line.json": golden_text([GOLDEN[0], GOLDEN[1].replace("splat", "sp\nlat")]),
    "two-in-one.json": golden_text([GOLDEN[0], f"{GOLDEN[1]}\n{GOLDEN[1].replace('a', 'b')}"]),
    "return.json": golden_text([GOLDEN[0], GOLDEN[1].replace("splat", "sp\rlat")]),
    "nameless.json": golden_text([GOLDEN[0], GOLDEN[1].replace(",a,", ",,")]),
    "infinite.json": golden_text([GOLDEN[0], GOLDEN[1].replace("0.5", "inf")]),
    "no-metric.json": golden_text(
        [line.replace(",ssim", "").replace(",0.5", "") for line in GOLDEN]
    ),
    "a-line-less.json": golden_text(
        [*GOLDEN, *(GOLDEN[1].replace("splat,2048,chair,a", cell) for cell in REMAINING)]
    ),
    "beauty.json": golden_text([line.replace("ssim", "beauty") for line in GOLDEN]),
    "no-protocol.json": golden_text(protocol=None),
    "empty-protocol.json": golden_text(protocol={}),
    "no-environment.json": golden_text(environment=None),
    **{f"golden-{version}.json": golden_text(version=version) for version in OTHER_VERSIONS},
    **{f"golden-{name}.json": golden_text(version=value) for name, value in NO_VERSIONS.items()},
    **{
        path: text
        for version in (*OTHER_VERSIONS, *NO_VERSIONS.values())
        for path, text in export_texts(f"exports/protocol-{version}", version).items()
    },
    "meshes/sofa/one.obj": "",
    "thesis/chapter1.tex": "",
    "cloud.xyz": "0 0 0\n1 0 0\n",
    "foreign.py": "from pathlib import Path\nPath('executed').touch()\n",
    **dict.fromkeys(("clouds/a.xyz", "clouds/more/b.xyz", "other/a.xyz"), "0 0 0\n1 0 0\n0 1 0\n"),
    "equal.xyz": "1 2 3\n1 2 3\n",
    **dict.fromkeys(("folder.png/x", "nothing/x"), ""),
    "options.toml": "suite = 'chair-robustness'",
    "brace.json": "{",
    "list.json": "[]",
    "empty.json": "{}",
}
REQUEST = Options("chair-robustness", seed=7, limit=5).request


def repeated(*numbers, **changes):
    """Return the manifest of a run with some of five chairs, to be repeated."""
    objects = [f"chair/test-{number:04d}" for number in numbers]
    return {"request": REQUEST, "objects": objects, "planned": 5} | changes


# Folders of runs that have a manifest alone: what is other than in that of a finished run.
MANIFESTS = {
    "unfinished": {"finished": None},
    "of-stability": {"suite": "stability"},
    "of-rounding": {"suite": "rounding"},
    "of-gray": {"truth": "gray"},
    "no-request": {"request": None},
    "protocol-0": repeated(0, 1, protocol=0),
    "schema-4": repeated(0, 1, schema_version=4),
    **{f"of-{name}": repeated(0, 1, protocol=value) for name, value in NO_VERSIONS.items()},
    "others": repeated(0, 2),
    "module": repeated(0, 1, methods=["foreign:METHOD"]),
    "true": repeated(0, 1, request=REQUEST | {"limit": True}),
    "grey": repeated(0, 1, request=REQUEST | {"truth": "gray"}),
}
OTHERS = "finish it with its command, bring its dataset back as it was, or give another --limit"
NO_VERSION = "its protocol is {!r}, no whole number; "
SPREAD = "spread must be a number from 0.1 to 10, not"
CASES: dict[str, str] = {
    # --- words of the command line
    "--foo": "No such option: --foo; see 'bench --help'",
    "run": "Missing option '--suite'; see 'bench run --help'",
    "table": "Missing argument 'DIR'; see 'bench table --help'",
    "render": "Missing argument 'CLOUD'; see 'bench render --help'",
    "run --suit chair-robustness": "No such option: --suit (Possible options: ",
    f"{ROBUSTNESS} --views many": "Invalid value for '--views': ",
    f"{ROBUSTNESS} --device gpu": "Invalid value for '--device': 'gpu' is not one of 'auto', 'cpu'",
    "train gan --steps x": "see 'bench train gan --help'",
    # --- names that there are not
    "rnder": "unknown command 'rnder': did you mean 'render'? there are run, list, table, check, "
    "report and 11 more; see 'bench --help'",
    "xyz": "unknown command 'xyz': there are run, list, table, check, report and 11 more; ",
    "train gann": "unknown command 'gann': did you mean 'gan'? there are autoencoder, ",
    "list metrcs": "unknown section 'metrcs': did you mean 'metrics'? there are suites, methods, "
    "variants, conditions, metrics and 1 more; see 'bench list --help'",
    "run --suite chair-robustnes": "unknown suite 'chair-robustnes': did you mean "
    "'chair-robustness'? there are chair-robustness, speed-accuracy, thirteen-classes, "
    "beyond-training, own-meshes and 3 more; see 'bench list'",
    f"{ROBUSTNESS} --methods splta,blank": "unknown method 'splta': did you mean 'splat'? there ",
    f"{ROBUSTNESS} --methods splta --dry-run": "unknown method 'splta': did you mean 'splat'? ",
    f"{ROBUSTNESS} --metrics nonsense --dry-run": "unknown metric 'nonsense': there are flip, ",
    f"{ROBUSTNESS} --methods pc2pix@x": "unknown method 'pc2pix@x': did you mean 'pc2pix'? there ",
    f"{ROBUSTNESS} --methods blank --conditions 2049": "unknown condition '2049': did you mean ",
    f"{ROBUSTNESS} --methods ' , '": "' , ': expected names separated by commas",
    f"{ROBUSTNESS} --dataset shapenet": "unknown dataset 'shapenet': did you mean 'shapenet:PATH'? "
    "there are procedural, folder:PATH, shapenet:PATH, modelnet:PATH, exported:PATH and 6 more; "
    "see 'bench list'",
    f"{ROBUSTNESS} --dataset folder:": "unknown dataset 'folder:': did you mean 'folder:PATH'? ",
    f"{ROBUSTNESS} --dataset /meshes": "unknown dataset '/meshes': did you mean 'folder:/meshes'?",
    "test no-such-method": "unknown method 'no-such-method'",
    "test nosuchmodule:Method": "no module 'nosuchmodule' in this folder or",
    "test 'a b:Method'": "no module 'a b' in this folder",
    # --- files and folders that are not there
    f"{ROBUSTNESS} --methods pc2pix@no.safetensors": "no.safetensors: no such weights file; train ",
    f"{ROBUSTNESS} --methods pc2pix@no.pt": "no.pt: weights are .safetensors files; 'bench train ",
    f"{ROBUSTNESS} --dataset folder:gone": "gone: no such folder; give the folder that holds your ",
    f"{ROBUSTNESS} --inception-weights no.pth": "no.pth: no such file; ",
    "table nowhere": "nowhere: no such folder; give a run's folder",
    "table cloud.xyz": "cloud.xyz: no run here (manifest.json is missing); give a run's folder",
    "table unfinished": "unfinished: the run is not finished; start it again with its command",
    "test folder:/no/such": "/no/such: no such folder",
    "data inspect nowhere": "nowhere: no such folder",
    "data inspect shapenet:thesis": "no ShapeNetCore here",
    "data verify meshes": "meshes: is no export; give the folder that",
    "data verify gone": "gone: no such folder; give the folder of an export",
    # --- numbers
    f"{ROBUSTNESS} --limit 0": "--limit 0: must be at least 1",
    f"{ROBUSTNESS} --views -2": "--views -2: must be at least 1",
    f"{ROBUSTNESS} --workers 0": "--workers 0: must be at least 1",
    f"{ROBUSTNESS} --views 99999999999999999999": "too many; give at most 10000",
    f"{ROBUSTNESS} --limit 100000000": "too many; give at most 10000, or leave it for all objects ",
    f"{ROBUSTNESS} --dry-run --views 0": "--views 0: must be at least 1",
    f"{ROBUSTNESS} --dry-run --limit 100000000": "too many; give at most 10000, or leave it for ",
    "data export --views 0 --out x": "--views 0: must be at least 1",
    "data export --limit 100000000 --out x": "too many; give at most 10000, or leave it for all ",
    "data inspect . --sample -1": "--sample -1: must be at least 0",
    "data inspect . --all --sample 5": "--sample 5: --all reads every object; leave out one",
    "data inspect procedural --all": "--all: procedural has as many objects as one asks for; give",
    "data inspect . --workers 0": "--workers 0: must be at least 1",
    # --- what has no meaning together
    "run --suite latent --truth grey": "--truth: has no meaning for the suite latent, which has ",
    "run --suite stability --truth grey": "--truth: has no meaning for the suite stability, which ",
    "run --suite speed --truth coloured": "--truth: has no meaning for the suite speed, which has ",
    "run --suite stability --metrics flip": "--metrics: has no meaning for the suite stability",
    f"{ROBUSTNESS} --metrics ssim": "metric 'ssim': suites that have it take it by themselves",
    "run --suite speed-accuracy --methods blank --workers 2": "--workers: has no meaning for the "
    "suite speed-accuracy, ",
    "run --suite speed-accuracy --dry-run --workers 2": "--workers: has no meaning",
    "run --suite speed --dry-run": "--dry-run: the suite speed has no jobs to describe and takes",
    "run --suite latent --dry-run": "--dry-run: the suite latent has no jobs to describe and takes",
    "run --suite latent --conditions 512": "has no meaning for the suite latent, clouds have",
    "run --suite latent --views 3": "has no meaning for the suite latent, everything is seen from",
    "run --suite latent --workers 2": "has no meaning for the suite latent, it works in one ",
    "run --suite latent --inception-weights x": "has no meaning for the suite latent",
    "run --suite latent --limit 0": "--limit 0: must be at least 1",
    "run --suite latent --methods splat": "has no code to do arithmetic with; use pc2pix",
    "run --suite latent --methods pc2pix@no.safetensors": "no.safetensors: no such weights file",
    "run --suite latent --dataset folder:meshes": "which only procedural ones have",
    "run --suite speed --workers 2": "--workers: has no meaning for the suite speed",
    "run --suite speed --inception-weights download": "--inception-weights: has no meaning",
    "run --suite speed --limit 0": "--limit 0: must be at least 1",
    "run --suite speed --views 0": "--views 0: must be at least 1",
    "run --suite speed --methods splot": "unknown method 'splot'",
    "run --suite speed --conditions 2049": "unknown condition '2049'",
    "run --suite speed --dataset nowhere": "unknown dataset 'nowhere'",
    "run --suite stability --conditions 2048": "--conditions: has no meaning",
    "run --suite stability --views 3": "--views: has no meaning",
    "run --suite stability --limit 1": "--limit: has no meaning",
    "run --suite stability --inception-weights download": "--inception-weights: has no meaning",
    "run --suite stability --dataset procedural:validation": "--dataset procedural:validation: the",
    "run --suite stability --methods splot": "unknown method 'splot'",
    # --- packages of 'bench new'
    "new network mine": "'network' is not one of 'method', 'metric', 'dataset'",
    "new method My-Method": "an id is kebab-case (a-z, 0-9 and single hyphens), as in my-meth",
    "new method ../escape": "an id is kebab-case",
    "new method my-method@a": "an id is kebab-case",
    "new method splat-net": "pc2pix-bench uses that id itself",
    "new method best-classical": "pc2pix-bench uses that id itself",
    "new metric ssim-object": "pc2pix-bench uses that id itself",
    "new dataset shapenet": "pc2pix-bench uses that id itself",
    "new method 3d-hull": "Python cannot import a module '3d_hull'",
    "new method lambda": "Python cannot import a module 'lambda'",
    "new metric numpy": "'numpy' is the name of another module or form already",
    # --- names with a near one, and variants
    f"{ROBUSTNESS} --methods surface": "unknown method 'surface': did you mean 'surface-fit'? ",
    f"{ROBUSTNESS} --methods Blank": "unknown method 'Blank': did you mean 'blank'? there are pc2",
    f"{ROBUSTNESS} --methods nosuch": "unknown method 'nosuch': there are pc2pix, ",
    **{
        f"{ROBUSTNESS} --methods splat@spread={text}": f"{SPREAD} '{text}'"
        for text in ("", "x", "nan", "inf", "1e9", "-1")
    },
    f"{ROBUSTNESS} --methods surface-apss@resolution=64.5": "resolution must be a whole number fr",
    f"{ROBUSTNESS} --methods splat@size=1": "unknown variant 'splat@size=1': there are surface-",
    f"{ROBUSTNESS} --methods nothing@spread=1": "unknown variant 'nothing@spread=1': there are ",
    f"{ROBUSTNESS} --methods pc2pix@width=2": "unknown variant 'pc2pix@width=2': there are ",
    "table of-rounding": "of-rounding: unknown suite 'rounding': did you mean ",
    f"compare run-{NEWER} --methods splat,blank": f"run-{NEWER}: of protocol {NEWER}, ",
    "table of-gray": "unknown truth 'gray': did you mean 'grey'? there are coloured, grey",
    # --- budgets
    **{
        f"render cloud.xyz --budget='{text}'": "give a time over 0 with its unit, as in 50ms"
        for text in ("", "50", "ms", "0ms", "-5ms", "1e3ms", "5 ms", "infs", "1h")
    },
    f"render cloud.xyz --budget {CHEAPEST_MS - 0.1:.1f}ms": "the cheapest method is splat with "
    f"{LEAST_MS} ms for one image; give at least {LEAST_MS}ms",
    f"{ROBUSTNESS} --workers 100000": "--workers 100000: too many processes; give at most 1024",
    # --- data, weights and folders of something else
    f"{ROBUSTNESS} --dataset folder:meshes": "folder:meshes: no class 'chair' (a sub-folder of tha",
    f"{ROBUSTNESS} --dataset 'folder:a\nb\x1b[2J\u202e'": "a\\nb\\x1b[2J\\u202e: no such folder; ",
    f"{ROBUSTNESS} --methods pc2pix@chair.safetensors --fresh": "chair.safetensors: not a whole sa",
    f"{ROBUSTNESS} --inception-weights chair.safetensors": "chair.safetensors: sha256 ",
    f"{ROBUSTNESS} --methods blank --out thesis": "thesis: not empty and not a run; ",
    f"{ROBUSTNESS} --methods blank --out thesis --dry-run": "thesis: not empty and not a run; ",
    f"{ROBUSTNESS} --methods blank --out thesis --fresh": "thesis: not empty and not a run; ",
    f"{ROBUSTNESS} --methods blank --out thesis/chapter1.tex": "thesis/chapter1.tex: is a file; gi",
    f"{ROBUSTNESS} --methods blank --views 2 --seed 3 --out run": "run: holds a run of seed 0, not",
    f"{ROBUSTNESS} --methods blank --views 2 --seed 3 --out run --dry-run": "run of seed 0, not 3;",
    "new method mine --out thesis": "thesis: exists already; give another folder with --out",
    "new method mine --out no/such/mine": "no/such/mine: cannot be made (No such file or direct",
    # --- runs that a command cannot use
    "add splat gone": "gone: no such folder; give a run's folder",
    "add splat unfinished": "the run is not finished; start it again with its command",
    "add splat of-stability": "a run of the suite stability; use 'bench run --suite stability "
    "--methods splat,true-mesh,blank --out of-stability'",
    "add splat others --dataset nowhere": "unknown dataset 'nowhere': there are procedural, ",
    "add splat others --dataset folder:gone": "gone: no such folder; give the fold",
    "add splat others --limit 3": "--limit: the objects are those of others; give --datase",
    "add images:gone others": "gone: no such folder; give a tree of images with its method.toml",
    "add images:thesis others": "thesis/method.toml: no such file",
    "table run --format tex": "Invalid value for '--format': 'tex' is not one of ",
    "add splat no-request": "manifest.json: not a manifest (request is None, no object)",
    "compare run --methods splat,true-mesh --metric flip": "run: is not scored by flip; run 'bench "
    "score run --metrics flip' first",
    "compare run --methods splat,true-mesh --metric unheard-of": "--metric unheard-of: cannot be c",
    "score run --metrics fid": "run: fid: not measured, not here; start the run again as this",
    "score run --metrics kid": "run: fid: not measured, not here; start the run again as this",
    "score run": "no installed package adds a metric; give --metrics flip,dists,st-lpips,",
    # --- manifests to repeat
    "run --config module/manifest.json": "foreign:METHOD: is of a module, which only a command li",
    "run --config true/manifest.json": "manifest.json: not a manifest (request.limit is True, no ",
    "run --config grey/manifest.json": "manifest.json: truth = 'gray': 'gray' is not one of ",
    "run --config options.toml": "options.toml: not a manifest (Expecting value: line 1 column 1 ",
    "run --config none.json": "none.json: no such file",
    "run --config brace.json": "brace.json: not a manifest (",
    "run --config list.json": "list.json: not a manifest (",
    "run --config empty.json": "empty.json: not a manifest (",
    "run --config protocol-0/manifest.json": "that made it, or give the manifest.json of another r",
    "run --config schema-4/manifest.json": "a run of version 1.0.0 or earlier (schema 4, this one ",
    "run --config others/manifest.json --dry-run": "the 2 objects of that run are "
    f"not the 2 that options can choose now; {OTHERS}",
    f"{ROBUSTNESS} --out=~nobody-of-this-name/y": "~nobody-of-this-name/y: no such user; give the ",
    # --- trainings
    "train splat-net --network huge": "--network: unknown 'huge'; choose one of default, points2pi",
    "train splat-net --objective l2": "objective: unknown 'l2'; choose one of l1, l1-patch",
    "train fused-net --turned 1.5": "turned 1.5: a share of the objects lies within 0 to 1",
    "train fused-net --start nosuch": "weights: 'nosuch' is neither a bundled name",
    "train splat-net --start chair --network points2pix": "--start chair: these are weights of sp",
    "train splat-net --batch 7": "batch 7: 2 views of a cloud are drawn together; use a multiple o",
    "train splat-net --views 1": "the training images have 1 views of an object, and a step needs",
    **{
        f"train gan --for='{text}'": f"--for {text}: give a time over 0 with its unit, as in 90s"
        for text in ("", "2", "m", "0s", "0.0h", "-2m", "2 m", "2min", "1e3s", "nan", "٢m", "2m30s")
    },
    "train autoencoder --objects 1 --out x --for 0.001s": "--for 0.001s: over before the first ste",
    "train upsampler --objects 1": "1 object: at least 2 are needed, as one is held out for valid",
    "train upsampler --batch 0": "--batch 0: must be at least 1",
    "train occupancy-net --steps 0": "--steps 0: must be at least 1",
    "train splat-net --batch 0": "--batch 0: must be at least 1",
}
CASES |= RENDERING
NO_GOLDEN = "no file of golden values of this version; 'bench check DIR --bless "
CASES |= {
    "check run --golden gone.json": "gone.json: no such file",
    "check run --golden meshes": "meshes: ",
    **{
        f"check run --golden {name}": f"{name}: {NO_GOLDEN}" for name in ("brace.json", "list.json")
    },
    **{
        f"check run --golden {name}.json": f"{name}.json: {problem}; write it again with 'bench "
        f"check DIR --bless {name}.json'"
        for name, problem in {
            "columns": "no golden values by object (other columns)",
            "words": "no golden values by object (could not convert string to float: 'half': Error "
            "while type casting for column 'ssim')",
            "no-lines": "no golden values by object ('NoneType' object is not iterable)",
            "empty-lines": "no golden values by object (No columns to parse from file)",
            "longer-lines": "no golden values by object (other columns)",
            "quote": "no golden values by object (Error tokenizing data. C error: EOF inside "
            "string starting at row 0)",
            "shorter-lines": "no golden values by object (other columns)",
            "twice": "no golden values by object (two lines of splat 2048 chair a)",
            "any": "no golden values by object (splat at the conditions 2048, any)",
            "broken-line": "no golden values by object (a line break in 'sp')",
            "two-in-one": "no golden values by object (a line break in 'splat,2048,chair,a,0.5,')",
            "nameless": "no golden values by object (a line without a name, or with an infinite "
            "value)",
            "infinite": "no golden values by object (a line without a name, or with an infinite "
            "value)",
            "no-metric": "no golden values by object (other columns)",
            "a-line-less": "no golden values by object (3 lines of splat, a whole run has 4)",
            "beauty": "beauty is no metric of images of this version",
            "no-protocol": "no golden values by object ('NoneType' object is not iterable)",
            "no-environment": "no golden values by object ('NoneType' object is not iterable)",
        }.items()
    },
    "check run --golden return.json": "return.json: no golden values by object (new-line character",
    "check run --golden empty-protocol.json": f"empty-protocol.json: {NO_VERSION.format(None)}",
    "check run --golden cloud.xyz --format junit": f"cloud.xyz: {NO_GOLDEN}",
    "check run --bless meshes": "meshes: a folder; give the name of a file, such as golden.json",
    "check run --bless a.json --golden b.json": "--bless: writes golden values; leave out --go",
    "check run --tolerance ssim=0.1": "--tolerance: the golden values of results/golden have tol",
    "check run --golden a --tolerance beauty=1": "--tolerance beauty=1: 'beauty' is no met",
    **{
        f"check run --golden a --tolerance ssim={value}": f"--tolerance ssim={value}: must be a num"
        for value in ("-1", "nan", "inf", "x", "")
    },
    "check run --claims --strict": "--claims: compares with the paper; leave out --strict",
    "check run --again 1 --golden a": "--again: compares a run with itself; leave out --golden",
    "compare run run --fail-on better": "Invalid value for '--fail-on': 'better' is not one of ",
}
OLD_WEIGHTS = (
    "old.safetensors: weights of version 1.0.0 or earlier (format splat-net-weights-1, now "
)
CASES |= {
    "render cloud.xyz --method splat-net@old.safetensors": OLD_WEIGHTS,
    "render cloud.xyz --method fused-net@old.safetensors": OLD_WEIGHTS,
    f"{ROBUSTNESS} --methods splat-net@old.safetensors": OLD_WEIGHTS,
    "train splat-net --start old.safetensors": OLD_WEIGHTS,
    "render cloud.xyz --method pc2pix@old.safetensors": "old.safetensors: expected format 'pc2pix-"
    "weights-1' in the header, found 'splat-net-weights-1'; write the file again with pc2pix.wei",
}
AGAIN = "run again with another --out or --fresh"
OF_OTHER_PROTOCOLS = {  # command lines on what is of protocol N, and the remedy that they say
    **dict.fromkeys(
        (
            *("table run-N", "report run-N", "report run run-N --out site"),
            *("check run-N", "check run-N --bless x.json", "check run-N --again 0.5"),
            *("check run-N --claims", "check run run-N --claims"),
            "check run-N --golden golden-N.json",
            *("compare run run-N", "compare run-N run", "compare run-N run-N"),
            *("compare run-N --methods splat,blank", "score run-N --metrics flip", "surface run-N"),
            *("add splat run-N", "add splat run-N --dataset procedural"),
            *(f"{ROBUSTNESS} --methods splat --out run-N", f"{ROBUSTNESS} --dry-run --out run-N"),
            *(f"run --suite {suite} --out run-N" for suite in ("stability", "speed", "latent")),
        ),
        f"or {AGAIN}",
    ),
    "run --config run-N/manifest.json": "or give the manifest.json of another run",
    f"{ROBUSTNESS} --dataset exported:exports/protocol-N": "or export it again",
    "data export --dataset exported:exports/protocol-N --out x": "or export it again",
    "add splat others --dataset exported:exports/protocol-N": "or export it again",
    "data inspect exports/protocol-N": "or export it again",
    "data verify exports/protocol-N": "or export it again",
    "test exported:exports/protocol-N": "or export it again",
    "check run --golden golden-N.json": "or write it again with 'bench check DIR --bless golden-N.",
}
for other in OTHER_VERSIONS:
    release = "update pc2pix-bench" if other == NEWER else "check out the release that made it"
    told = f"of protocol {other}, this version has protocol {PROTOCOL_VERSION} ('bench --protocol'"
    CASES |= {
        line.replace("-N", f"-{other}"): f"{told}); {release}, {remedy}".replace("-N", f"-{other}")
        for line, remedy in OF_OTHER_PROTOCOLS.items()
    }
for name, value in NO_VERSIONS.items():
    says = NO_VERSION.format(value)
    export = f"exports/protocol-{value}"
    CASES |= {
        **{f"{command} of-{name}": f"{says}{AGAIN}" for command in ("table", "check", "report")},
        f"run --config of-{name}/manifest.json": f"{says}give the manifest.json of another run",
        f"check run --golden golden-{name}.json": f"{says}write it again with 'bench check DIR ",
        f'data verify "{export}"': f"{NO_VERSION.format(str(value))}export it again",
        f'{ROBUSTNESS} --dataset "exported:{export}"': "no whole number; export it again",
    }
OF_1 = (
    "version 1.0.0 or earlier (schema {}, this one reads 5), which this one does not read; start it"
)
STORE_1 = """PRAGMA application_id = 0x70633270; PRAGMA user_version = 1;
CREATE TABLE jobs (id INTEGER PRIMARY KEY, key TEXT NOT NULL UNIQUE, records BLOB NOT NULL);"""
ONE_LESS = "DELETE FROM listed WHERE method = 'splat' AND condition = '512' AND object = 'a';"
NAMES = ("methods", "conditions", "objects")
# Copies of a finished run: what every reader says of it, entries of its manifest that are others or
# none (None: it is gone), and what is done to its store (None: it is gone).
PARTS: dict[str, tuple[str, dict | None, str | None]] = {
    "no-manifest": ("no run here (manifest.json is missing); give a run's folder", None, ""),
    "newer": (
        "by a newer version (schema 6, this one reads up to 5);",
        {"schema_version": 6},
        "",
    ),
    "schema-4-run": (OF_1.format(4), {"schema_version": 4}, ""),
    "no-protocol": (
        "not a manifest (no protocol); move it away and run again",
        {"protocol": None},
        "",
    ),
    "no-names": (f"not a manifest (no {', '.join(NAMES)}); move", dict.fromkeys(NAMES), ""),
    "no-store": ("no finished jobs in run.sqlite; the run is not finished, start it", {}, None),
    "store-1": ("a store of version 2.0.0 or earlier, which this one does not read", {}, STORE_1),
    "a-job-less": ("lists no job of splat 512 chair a (1 of ", {}, ONE_LESS),
}
for name, (says, _, _) in PARTS.items():
    CASES |= {f"{command} {name}": says for command in ("table", "check", "report")}
    CASES[f"score {name} --metrics flip"] = says
    CASES[f"compare {name} --methods splat,blank"] = says
    if name in ("newer", "schema-4-run", "no-protocol", "no-names", "store-1"):
        CASES[f"{ROBUSTNESS} --views 2 --device cpu --out {name}"] = says
WITHOUT_GPU = [
    f"{ROBUSTNESS} --methods splat",
    f"{ROBUSTNESS} --ray local",
    f"{ROBUSTNESS} --dry-run",
    "run --suite stability",
    "run --suite speed-accuracy",
    "train autoencoder --objects 1 --out x",
]


def tree(folder):
    """Return all files below, with their times and sizes."""
    return {path: path.lstat()[6:9:2] for path in folder.rglob("*")}


@pytest.fixture(scope="module")
def folder(tmp_path_factory, tiny_weights):
    """Return the folder with FILES, MANIFESTS, and runs of this and all other protocols."""
    folder = tmp_path_factory.mktemp("here")
    for name, text in FILES.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    (folder / "chair.safetensors").write_bytes(tiny_weights.read_bytes()[:-1])
    save_file({}, folder / "old.safetensors", {"format": "splat-net-weights-1"})
    for name, changes in MANIFESTS.items():
        (folder / name).mkdir()
        write_manifest(folder / name, make_manifest(**changes))
    run = write_run(folder / "run")
    manifest = json.loads((run / "manifest.json").read_text())
    for version in OTHER_VERSIONS:
        shutil.copytree(run, folder / f"run-{version}")
        write_manifest(folder / f"run-{version}", manifest | {"protocol": version})
    for name, (_, changes, store) in PARTS.items():
        shutil.copytree(run, folder / name)
        if changes is None:
            (folder / name / "manifest.json").unlink()
        else:
            gone = {entry for entry in changes if changes[entry] is None}
            kept = {k: v for k, v in (manifest | changes).items() if k not in gone}
            write_manifest(folder / name, kept)
        if store in (None, STORE_1):
            (folder / name / STORE).unlink()
        if store:
            with closing(sqlite3.connect(folder / name / STORE)) as database, database:
                database.executescript(store)
    return folder


@pytest.fixture
def refused_here(refused, no_machine, folder, monkeypatch):
    """Return the one line of a command line that is refused in the folder."""
    monkeypatch.chdir(folder)
    monkeypatch.setenv(ALLOWED, "")

    def run(line):
        before = tree(folder)
        said = refused(*shlex.split(line))
        assert tree(folder) == before
        return said

    return run


@pytest.mark.parametrize(("line", "says"), CASES.items())
def test_one_line_says_why_and_nothing_is_written(refused_here, line, says):
    if line.startswith("train splat-net") or line.startswith("train fused-net"):
        line += " --objects 1 --steps 1 --out trained"
    assert says in refused_here(line)


def test_bundled_weights_that_were_altered(refused_here, folder, monkeypatch):
    files = replace(WEIGHTS["pc2pix"], folder=folder, bundled={"chair": "0" * 64})
    monkeypatch.setitem(WEIGHTS, "pc2pix", files)
    path = folder / "chair.safetensors"
    expected = f"{path}: sha256 {file_sha256(path)} is not the expected 00"
    assert refused_here(f"{ROBUSTNESS} --methods pc2pix").startswith(expected)


def test_fresh_renames_a_run_of_another_protocol(tmp_path):
    write_manifest(tmp_path, make_manifest(protocol=OLDER))
    assert set_aside(tmp_path) == tmp_path.with_name(f"{tmp_path.name}.old-1")


@pytest.mark.parametrize("version", OTHER_VERSIONS)
def test_the_report_of_a_run_of_another_protocol_is_not_shown(folder, version):
    with pytest.raises(BadInput, match=rf"run-{version}: of protocol {version}, .*; .* or run ag"):
        bench.show(folder / f"run-{version}")


DOWNLOAD = "--inception-weights download"
GREY = "--inception-weights: chair-robustness takes no fid against the true mesh in grey; leave it"
NO_WEIGHTS = "no weights; add --inception-weights download (95 MB, once)"
WITHOUT_FID = {  # asked for, and cannot be met
    f"{ROBUSTNESS} {DOWNLOAD}": "the FID weights cannot be fetched (<urlopen error [Errno 2] No ",
    f"{ROBUSTNESS} {DOWNLOAD} --truth grey": GREY,
    f"{ROBUSTNESS} {DOWNLOAD} --truth grey --dry-run": GREY,
    f"{ROBUSTNESS} --metrics fid": f"metric 'fid': {NO_WEIGHTS}",
    f"{ROBUSTNESS} --metrics kid --dry-run": f"metric 'kid': {NO_WEIGHTS}",
}


@pytest.mark.parametrize(("line", "says"), WITHOUT_FID.items())
def test_a_request_for_fid_that_cannot_be_met_fails_before_the_first_job(
    refused_here, tmp_path_factory, monkeypatch, line, says
):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
    monkeypatch.setattr(inception_weights, "WEIGHTS_URL", "file:/no/such/weights.pth")
    assert refused_here(line).startswith(says)


@pytest.mark.skipif(torch.cuda.is_available(), reason="needs a machine without a GPU")
@pytest.mark.parametrize("line", WITHOUT_GPU)
def test_a_gpu_that_is_not_there_is_refused_before_the_first_job(refused_here, line):
    said = refused_here(f"{line} --device cuda")
    assert said.startswith(f"--device cuda: PyTorch {torch.__version__} ")
    assert "finds no usable GPU; use --device cpu" in said
