"""Prepared surfaces: their mirror images, what is left of them for quick maps, and how they are stored."""

import numpy as np
import pytest

from collalign.engine.records import decode, encode, from_record, to_record
from collalign.nonrigid.map_options import SurfaceOptions
from collalign.nonrigid.spectral_shape import (
    NUM_ORIENTATION,
    SpectralShape,
    orientation_form,
    prepare_surface,
    signed_volume,
)
from data_tools.datasets.synthetic_shapes import blob
from data_tools.errors import StoreError


@pytest.fixture(scope="module")
def prepared():
    shape = blob(np.random.default_rng(3), num_vertices=500)
    return prepare_surface(shape, SurfaceOptions(num_functions=30, num_samples=20, num_dense=80))


def form_of(surface):
    form = orientation_form(surface.working_shape, surface.functions[:, :NUM_ORIENTATION])
    return form[surface.dense]


def test_a_mirror_image_is_outward_and_has_the_orientation_of_its_own_surface(prepared):
    image = prepared.mirrored
    assert signed_volume(image.working_shape) == pytest.approx(
        signed_volume(prepared.working_shape)
    )
    np.testing.assert_allclose(image.orientation, form_of(image), atol=1e-9)
    assert not np.allclose(prepared.orientation, form_of(image), atol=1e-3)
    np.testing.assert_allclose(image.mirrored.vertices, prepared.vertices)


def test_a_coarse_surface_keeps_its_triangles_and_the_first_of_the_rest(prepared):
    few = prepared.coarse(40, 12)
    np.testing.assert_array_equal(few.dense, prepared.dense[:40])
    np.testing.assert_allclose(few.orientation, form_of(few), atol=1e-9)
    assert few.basis.shape == (len(prepared.vertices), 13)
    np.testing.assert_array_equal(few.faces, prepared.faces)


def test_a_stored_surface_is_the_same_and_a_damaged_one_is_refused(prepared):
    record = to_record(prepared)
    again = from_record(SpectralShape, decode(encode(record), "s"), "s")
    np.testing.assert_array_equal(again.tips.distances, prepared.tips.distances)
    np.testing.assert_array_equal(again.places.weights, prepared.places.weights)
    np.testing.assert_array_equal(again.functions, prepared.functions)
    with pytest.raises(StoreError, match="agd"):
        from_record(SpectralShape, record | {"agd": prepared.agd[1:]}, "s")
