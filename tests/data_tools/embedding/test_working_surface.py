import numpy as np

from data_tools.datasets.synthetic_shapes import blob, chair, sphere_mesh
from data_tools.embedding import working_surface
from data_tools.embedding.working_surface import WorkingSurface
from data_tools.notes import Note
from data_tools.options import SamplingOptions
from data_tools.surface.shape import Shape

SMALL = SamplingOptions(max_faces=1000)


def test_clouds_are_thinned(rng, monkeypatch):
    monkeypatch.setattr(working_surface, "MOST_CLOUD_POINTS", 1000)
    cloud = Shape.from_arrays(blob(rng, num_vertices=3000).vertices)
    surface = WorkingSurface(cloud, SMALL)
    assert len(surface.shape.vertices) == 1000
    np.testing.assert_array_equal(cloud.vertices[surface.to_original], surface.shape.vertices)
    assert surface.notes == (Note("subsampled", values={"kept": 1000, "total": 3000}),)


def test_stray_vertices_are_left_out():
    vertices, faces = sphere_mesh(100)
    stray = Shape.from_arrays(np.concatenate([[[9.0, 9, 9]], vertices]), faces + 1)
    surface = WorkingSurface(stray, SMALL)
    np.testing.assert_array_equal(surface.to_original, np.arange(1, 101))
    assert surface.operators.kind == "cotangent"
    assert surface.geodesics.method == "heat"


def test_what_is_unusual_is_noted():
    vertices, faces = sphere_mesh(100)
    fins = np.concatenate([faces, [[faces[0, 0], faces[0, 1], 50]]])
    surface = WorkingSurface(Shape.from_arrays(vertices, fins), SMALL)
    assert surface.operators.kind == "tufted"
    assert surface.notes[0].code == "tufted-laplacian"
    two = Shape.from_arrays(
        np.concatenate([vertices, vertices + 5]), np.concatenate([faces, faces + 100])
    )
    parts = WorkingSurface(two, SMALL)
    assert parts.geodesics.method == "shortest paths"
    assert parts.notes[0].code == "edge-geodesics"


def test_spectra_are_as_long_as_the_surface_allows():
    surface = WorkingSurface(Shape.from_arrays(*sphere_mesh(30)), SMALL)
    assert surface.eigenfunctions(60).functions.shape == (30, 28)


def test_a_copy_from_which_a_part_has_come_off_is_made_finer(monkeypatch):
    shape, asked = chair(), []

    def decimated(vertices, faces, max_faces):
        asked.append(max_faces)
        back = (vertices[faces][..., 2] > np.quantile(vertices[:, 2], 0.7)).all(
            axis=1, keepdims=True
        )
        apart = np.where(back, faces + len(vertices), faces)
        return (
            (np.concatenate([vertices, vertices + 5.0]), apart)
            if len(asked) == 1
            else (vertices, faces)
        )

    monkeypatch.setattr("data_tools.embedding.working_surface.decimate", decimated)
    surface = WorkingSurface(shape, SMALL)
    assert asked == [asked[0], 2 * asked[0]]
    assert len(surface.shape.faces) == len(shape.faces)
