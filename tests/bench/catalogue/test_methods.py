"""The table of methods: what each says about itself."""

from __future__ import annotations

from dataclasses import replace

from bench.catalogue.methods import (
    BUNDLED,
    FLOORS,
    METHODS,
    RECOMMENDED,
    RECOMMENDED_IN_COLOUR,
    Method,
    find_method,
    role,
)


def test_every_method_says_what_it_was_trained_on():
    trained = {method.id: method.trained_on for method in BUNDLED}
    assert {name for name, on in trained.items() if on == "13 classes"} == {
        *("pc2pix@all", "splat-net", "splat-net@grey", "splat-net@tiny", "splat-net@tiny-grey"),
        *("points2pix", "occupancy-net"),
        *("fused-net", "fused-net@grey"),
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


def test_a_plug_in_need_not_say_its_kind():
    plug_in = Method("hull", lambda device: None, str, 1, "", sees_cloud=False)
    assert (plug_in.kind, plug_in.color, plug_in.role) == ("", "", "")
    assert replace(plug_in, id="hull@fine").family == "hull"
    assert replace(plug_in, kind="reference").role == "floor"
    assert replace(plug_in, sees_mesh=True).role == "ceiling"


def test_what_draws_an_unknown_object_knows_more_than_chairs():
    method = find_method(RECOMMENDED)
    assert method in METHODS
    assert (method.trained_on, method.color) == ("13 classes", "none")
    coloured = find_method(RECOMMENDED_IN_COLOUR)
    assert (coloured.trained_on, coloured.color) == ("13 classes", "invented")
    assert coloured.family == method.family
