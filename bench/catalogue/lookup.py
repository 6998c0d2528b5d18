"""Ids: entries of literal tables by them, the parts of a method's, and names that are gone."""

from __future__ import annotations

from collections.abc import Sequence

from data_prep import failures
from data_prep.failures import BadInput
from data_prep.plugins import Entry

# Names that versions before 2.0 had: by kind, the name and what to use now, for whoever has them in
# a script or a manifest. An option stands with its command: "run --open".
GONE: dict[str, dict[str, str]] = {
    "command": {
        "plan": "'bench run --dry-run' says jobs, disk and time",
        "receipt": "'bench check DIR --again 0.05' computes a share of a run's jobs again",
        "verify": "'bench check DIR --again 0.05' computes a share of a run's jobs again",
        "site": "use 'bench report DIR...', which writes an index over the runs",
    },
    "option": {
        "run --until-decided": "use --budget, or end the run with Ctrl-C",
        "run --no-until-decided": "leave it; no run ends by itself",
        **dict.fromkeys(
            ("run --open", "report --open"),
            "the path of the page is printed; open it in a browser",
        ),
        "run --search": "hypothesis tests in tests/robustness/test_generated_inputs.py",
        "train gan --grow": "all steps are at 128 px",
        "train splat-net --without": "the inputs are those of --network",
        "train fused-net --network": "leave it; there is one network",
    },
    "suite": {
        "chair-robustness-grey": "use 'bench run --suite chair-robustness --truth grey'",
        "rounding": "the case last-bit of the suite stability measures it",
    },
    "method": {
        "auto": "'bench render --budget 50ms' chooses by time",
        "alpha-shape": "use alpha-wrap, which is ahead of it",
        "denoised-alpha": "use denoised-wrap, which is ahead of it",
        "denoised-bpa": "use denoised-wrap, which is ahead of it",
        "denoised-poisson": "use denoised-wrap, which is ahead of it",
        "pgr": "use denoised-wrap, which is ahead of it",
        "wnnc-poisson": "use denoised-wrap, which is ahead of it",
        "depth-net": "use splat-net, which sees more than the nearest depth",
        "points2pix@l1-patch": "use points2pix, or splat-net, which has that loss",
        "splat-net@chair-grey": "use splat-net@grey, which knows chairs, too",
        "splat-net@chair-large": "use splat-net@chair, which is as good",
        "splat-net@chair-no-normals": "use splat-net@chair, which is better",
        "splat-net@chair-tiny": "use splat-net@chair, which is better",
        "splat-net@tiny": "use splat-net; splat draws the cheapest images",
        "splat-net@tiny-grey": "use splat-net@grey; splat draws the cheapest images",
        "pc2pix@widened": "use pc2pix@all, which knows more shapes",
        "pc2pix@bf16": "use pc2pix, in float32",
        "pc2pix@paper-bf16": "use pc2pix@paper, in float32",
        "splat-net@chair-bf16": "use splat-net@chair, in float32",
        "pc2pix@unfolded": "use pc2pix, which draws the same images",
        "pc2pix@one-by-one": "use pc2pix; tables of costs have its time for one view, too",
    },
    "metric": {
        "silhouette-distance": "use silhouette-iou, which every suite with true images shows",
        "alexnet-precision": "use kd-alexnet, the kernel distance on the same features",
        "alexnet-recall": "use kd-alexnet, the kernel distance on the same features",
        "cw-ssim": "use st-lpips, which forgives small shifts, too",
        "fd-effnet": "use fd-alexnet, of another network of photographs",
        "kd-effnet": "use kd-alexnet, of another network of photographs",
    },
    "condition": {
        "1024-random": "use 1024, which is a random subset where points are independent draws",
        "512-random": "use 512, which is a random subset where points are independent draws",
        "noise-0.05-code": "use noise-0.10, which has the same deviation in units of the radius",
        "noise-0.10-code": "use noise-0.20, which has the same deviation in units of the radius",
    },
}


def instead_of(kind: str, wanted: str) -> str | None:
    """Return the line about a name that is gone, or about a variant of one; None for others."""
    for name in (wanted, wanted.partition("@")[0]):
        if instead := GONE.get(kind, {}).get(name):
            return f"{kind} '{wanted}' went with version 2.0: {instead}"
    return None


def unknown(
    wanted: str, names: Sequence[str], kind: str, near: str = "", see: str = "bench list"
) -> BadInput:
    """Return an error as `data_prep.failures.unknown`; for a name that is gone what replaces it."""
    if line := instead_of(kind, wanted):
        return BadInput(line)
    return failures.unknown(wanted, names, kind, near, see)


def find(wanted: str, table: Sequence[Entry], kind: str) -> Entry:
    """Return the entry whose id is `wanted`. Raises BadInput that suggests the nearest."""
    for entry in table:
        if entry.id == wanted:
            return entry
    raise unknown(wanted, [entry.id for entry in table], kind)


def family_of(method_id: str) -> str:
    """Return the id of a method without its variant: "splat-net" of "splat-net@grey"."""
    return method_id.partition("@")[0]


def variant_of(method_id: str) -> str:
    """Return the variant in an id: a name, PARAMETER=VALUE or a file of weights; "" for none."""
    return method_id.partition("@")[2]
