"""The table of methods: what each says about itself, its variants and its loader."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from bench.catalogue.methods import (
    BUNDLED,
    COST_VARIANTS,
    FLOORS,
    METHODS,
    PARAMETERS,
    RECOMMENDED,
    RECOMMENDED_IN_COLOUR,
    Method,
    find_method,
    find_setting,
    role,
)
from data_prep.failures import BadInput
from data_prep.files.checksums import file_sha256
from data_prep.scene import View
from tests.baselines.clouds import chair_cloud


def test_every_method_says_what_it_was_trained_on():
    trained = {method.id: method.trained_on for method in BUNDLED}
    assert {name for name, on in trained.items() if on == "13 classes"} == {
        *("pc2pix@all", "splat-net", "splat-net@grey", "points2pix", "occupancy-net"),
        *("fused-net", "fused-net@grey", "upsampled-wrap"),
    }
    learned = {name for name, on in trained.items() if on != "nothing"}
    assert learned == {m.id for m in BUNDLED if m.kind == "network"} | {"constant"}
    assert None not in trained.values()
    assert find_method("splat@spread=1.5").trained_on == "nothing"


def test_the_card_of_each_network_says_the_same():
    for method in BUNDLED:
        if method.weights_file is None:
            continue
        weights = method.weights_file()
        cards = [card.read_text() for card in weights.parent.glob("*.md")]
        (card,) = (text for text in cards if f"`{weights.name}`" in text.split("| trained on |")[1])
        assert f"| trained on | {method.trained_on} |" in card, method.id


def test_every_method_says_its_kind_and_its_colours():
    for method in BUNDLED:
        assert (method.kind == "network") == (method.weights_file is not None)
        assert (method.kind == "reference") == (role(method.id) != "")
        assert method.color
    assert [m.id for m in BUNDLED if m.kind == "splat"] == ["splat", "splat-fill"]
    assert [m.id for m in BUNDLED if m.color == "true"] == ["true-mesh"]
    assert FLOORS == ("constant", "blank")
    variant = find_method("surface-apss@resolution=64")
    assert (variant.family, variant.kind) == ("surface-apss", "reconstruction")


def test_the_size_drawn_is_the_next_larger_or_the_largest():
    fused, mesh = find_method("fused-net@grey"), find_method("poisson")
    two = replace(fused, sizes=(128, 256))
    assert [two.drawn_at(size) for size in (16, 128, 129, 256, 2048)] == [128, 128, 256, 256, 256]
    assert [fused.drawn_at(size) for size in (16, 128, 129, 2048)] == [128, 128, 129, 2048]
    assert [mesh.drawn_at(size) for size in (16, 1000)] == [16, 1000]


@pytest.mark.parametrize("sizes", [(), (256,), (256, 128), (128, 256.0), 128, "any", None])
def test_sizes_that_a_method_cannot_have(sizes):
    with pytest.raises(BadInput, match=r"method 'hull': sizes .*; give whole numbers in ascending"):
        Method("hull", lambda device: None, str, 1, "", sizes=sizes)


def test_a_plug_in_need_not_say_its_kind():
    plug_in = Method("hull@fine", lambda device: None, str, 1, "", sees_cloud=False)
    assert (plug_in.kind, plug_in.color, plug_in.role, plug_in.family) == ("", "", "", "hull")
    assert replace(plug_in, kind="reference").role == "floor"
    assert replace(plug_in, sees_mesh=True).role == "ceiling"


def test_what_draws_an_unknown_object_knows_more_than_chairs():
    method = find_method(RECOMMENDED)
    assert method in METHODS
    assert (method.trained_on, method.color) == ("13 classes", "none")
    coloured = find_method(RECOMMENDED_IN_COLOUR)
    assert (coloured.trained_on, coloured.color) == ("13 classes", "invented")
    assert coloured.family == method.family


def test_an_id_says_parameter_and_value():
    setting = find_setting("surface-apss@resolution=64")
    assert setting is not None
    assert (setting.parameter.method, setting.parameter.name) == ("surface-apss", "resolution")
    assert (setting.value, type(setting.value)) == (64, int)
    others = ("splat", "pc2pix@paper", "pc2pix@a=b.safetensors", "surface-apss@64", "a=b", "")
    assert [*map(find_setting, others)] == [None] * len(others)


@pytest.mark.parametrize("parameter", PARAMETERS, ids=lambda parameter: parameter.method)
def test_the_renderer_has_its_parameter_set_within_the_bounds(parameter):
    method = find_method(parameter.method)
    step = 1 if parameter.whole else 0.01
    for value in (parameter.low, parameter.high):
        variant = find_method(f"{parameter.method}@{parameter.name}={value:g}")
        assert variant.id == f"{parameter.method}@{parameter.name}={value:g}"
        assert getattr(variant.load("cpu"), parameter.field or parameter.name) == value
        assert (variant.version, variant.weights_file) == (method.version, method.weights_file)
    for value in (parameter.low - step, parameter.high + step):
        with pytest.raises(BadInput, match=rf"{parameter.name} must be a .*not '{value:g}'"):
            find_method(f"{parameter.method}@{parameter.name}={value:g}")


def test_cost_variants_are_found_but_no_methods_of_the_list():
    for variant in COST_VARIANTS:
        assert find_method(variant.id) is variant
        assert variant not in METHODS


def test_grey_methods_keep_the_keys_of_their_jobs():
    """The tensors of splat-net@grey are those of the file that it had."""
    kept = "0445cfb77209b1c073dd734f0fe6b3307884d28faf3f498a5d50375f5c589416"
    identity = find_method("splat-net@grey").identity()
    assert re.search("weights ([0-9a-f]{64})", identity).group(1) == kept
    assert file_sha256(find_method("splat-net@grey").weights_file()) not in identity
    for name in ("splat-net", "fused-net", "fused-net@grey"):
        assert file_sha256(find_method(name).weights_file()) in find_method(name).identity()


def test_the_paper_width_is_the_papers():
    """A generator that is made anew each time draws the same images, by its seed."""
    renderer, again = (find_method("pc2pix@paper").load("cpu") for _ in range(2))
    assert renderer.weights.generator.config == replace(
        find_method("pc2pix").load("cpu").weights.generator.config, width=1.0
    )
    views = [View(30, 20)]
    image = renderer.draw(renderer.prepare(chair_cloud(256)), views)
    assert np.array_equal(again.draw(again.prepare(chair_cloud(256)), views), image)
