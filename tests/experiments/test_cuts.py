"""Cut bodies lack what was cut away, and the table counts what is found and what is true."""

import numpy as np
import pytest

from collalign.confidence.map_model import NEAR
from data_tools.surface.topology import boundary_edges, mesh_components
from experiments.generated.bipeds import KINDS, biped, template_points
from experiments.generated.cut_bipeds import CUTS, cut_biped
from experiments.maps.cuts import row_of


@pytest.mark.parametrize("cut", CUTS)
def test_a_cut_body_is_one_open_piece_that_lacks_what_was_cut_away(cut, rng):
    body = biped(KINDS["child"], rng)
    found = cut_biped(body, cut)
    assert mesh_components(len(found.shape.vertices), found.shape.faces)[0] == 1
    assert len(boundary_edges(found.shape.faces))
    assert CUTS[cut](template_points()[found.to_template]).all()
    own = body.places[found.to_template]
    np.testing.assert_allclose(body.shape.vertices[own].std(), found.shape.vertices.std(), rtol=0.1)
    truth = found.true_map_from(body)
    assert 0.02 < (truth < 0).mean() < 0.8
    kept = np.flatnonzero(truth >= 0)
    off = np.linalg.norm(found.shape.vertices[truth[kept]] - body.shape.vertices[kept], axis=1)
    assert np.median(off) < 0.03
    assert (found.places < 0).any()


def record(error, lost, said, both, stated=0.5):
    return {"error": error, "lost": lost, "said": said, "both": both, "stated": stated}


def test_a_row_counts_what_is_found_and_what_is_true():
    row = row_of("all", [record(0.02, 90, 60, 60), record(2 * NEAR, 10, 20, 0)])
    assert (row["pairs"], row["right"]) == (2, 1)
    assert row["found"] == pytest.approx(60.0)
    assert row["true"] == pytest.approx(75.0)
    assert (row["sure"], row["sure_right"]) == (0, 0)
    assert row_of("none said", [record(0.5, 10, 0, 0)])["true"] == 0.0


def test_a_row_counts_sure_maps_and_how_many_of_these_are_right():
    sure = [record(error, 10, 5, 5, stated=0.95) for error in (0.02, 0.03, 2 * NEAR)]
    row = row_of("all", [*sure, record(0.02, 10, 5, 5)])
    assert (row["sure"], row["sure_right"]) == (3, 2)
