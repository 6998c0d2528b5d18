"""The version of the protocol: of the objects, views, perturbations and scores of tables."""

from __future__ import annotations

from data_prep.failures import BadInput

# Add one when tables of two commits can no longer be compared. The sealed split is then another.
CHANGES = {
    1: "procedural chairs and classes of version 1; 20 views an object; the conditions of Tables 3 "
    "and 4; SSIM, LPIPS, outlines, thin parts, and distances of features",
    2: "another sealed split; best-classical is alpha wrapping, of the points as they are or, "
    "under noise, denoised, with 5 % of outliers and more surface-bpa; the suites measure "
    "fused-net, and occupancy-net in grey, in place of methods that others dominate; splat-net, "
    "splat-net@grey and pc2pix@acgan have other weights",
    3: "another sealed split; best-classical is, by each metric and at each condition, the best of "
    "all that learns nothing, splat-fill among them, which chair-robustness and beyond-training "
    "measure; occupancy-net, fused-net and, under noise, denoised-wrap draw other images",
    4: "another sealed split; a mean is over objects, of each object's mean over its images, where "
    "it was over images: thin-recall and thin-precision, which some images lack, have other values",
}
PROTOCOL_VERSION = max(CHANGES)


def refuse_other_version(
    where: object, version: object, instead: str = "run again with another --out or --fresh"
) -> None:
    """Raise BadInput where something is of another version of the protocol than this code.

    The message names `where`, a folder or file, and `instead`, the remedy beside the use of the
    release that fits. What is no whole number is refused as well: null, true, "4" and 4.0.
    """
    if type(version) is not int:
        raise BadInput(f"{where}: its protocol is {version!r:.40}, no whole number; {instead}")
    if version == PROTOCOL_VERSION:
        return
    newer = version > PROTOCOL_VERSION
    release = "update pc2pix-bench" if newer else "check out the release that made it"
    raise BadInput(
        f"{where}: of protocol {version!r:.40}, this version has protocol {PROTOCOL_VERSION} "
        f"('bench --protocol'); {release}, or {instead}"
    )
