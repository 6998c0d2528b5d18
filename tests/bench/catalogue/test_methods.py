"""The table of methods: what each says about itself."""

from __future__ import annotations

from bench.catalogue.methods import COST_VARIANTS, METHODS, RECOMMENDED, find_method


def test_every_method_says_what_it_was_trained_on():
    trained = {method.id: method.trained_on for method in (*METHODS, *COST_VARIANTS)}
    assert {name for name, on in trained.items() if on == "13 classes"} == {
        *("pc2pix@all", "splat-net@all", "splat-net@all-grey"),
        *("points2pix", "points2pix@l1-patch", "depth-net"),
    }
    networks = {method.id for method in (*METHODS, *COST_VARIANTS) if method.weights_file}
    learned = {name for name, on in trained.items() if on != "nothing"}
    assert learned == networks | {"constant"}
    assert None not in trained.values()
    assert find_method("splat@spread=1.5").trained_on == "nothing"


def test_what_draws_an_unknown_object_knows_more_than_chairs():
    assert find_method(RECOMMENDED).trained_on == "13 classes"
