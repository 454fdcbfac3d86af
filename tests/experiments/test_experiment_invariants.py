"""What is done to shapes before invariants are compared, and the experiment end to end on generated shapes."""

import numpy as np
import pytest

from collalign.engine.store.store import Store
from data_tools.datasets.synthetic_shapes import crown
from experiments.experiment import Bench
from experiments.pairs import invariants


def test_a_quarter_is_cut_off_on_one_side(rng):
    shape = crown(rng)
    direction = np.array([1.0, 0.0, 0.0])
    cut = invariants.without_quarter(shape, direction)
    limit = np.quantile(shape.vertices[:, 0], 0.75)
    assert cut.vertices[:, 0].max() <= limit
    assert len(cut.vertices) == pytest.approx(0.75 * len(shape.vertices), rel=0.02)
    assert set(np.unique(cut.faces)) == set(range(len(cut.vertices)))
    kept = {tuple(vertex) for vertex in shape.vertices[shape.vertices[:, 0] <= limit]}
    assert {tuple(vertex) for vertex in cut.vertices} <= kept


@pytest.mark.parametrize(("state", "is_mesh"), [("stored", True), ("rough", True), ("points", False), ("cut", True)])
def test_damage_changes_what_it_says(state, is_mesh, rng):
    shape = crown(rng, num_vertices=2500)
    damaged = invariants.damage(shape, state, rng)
    assert damaged.is_mesh is is_mesh
    assert (damaged is shape) == (state == "stored")
    if state == "rough":
        offsets = damaged.vertices - shape.vertices
        diagonal = np.linalg.norm(np.ptp(shape.vertices, axis=0))
        assert offsets.std() == pytest.approx(invariants.ROUGHNESS * diagonal, rel=0.05)
    if state == "points":
        assert len(damaged.vertices) == invariants.NUM_POINTS


def test_the_experiment_measures_generated_shapes(tmp_path):
    bench = Bench(data=tmp_path, store=Store.memory(), quick=True, quiet=True)
    (table,) = invariants.measure(bench).tables
    shares = {row["state"]: row for row in table.rows}
    assert set(shares) == set(invariants.STATES.values())
    assert shares["as stored"]["invariants_64"] >= 75
