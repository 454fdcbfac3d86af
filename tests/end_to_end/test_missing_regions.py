"""What follows from a broken shape in all that is made of a result: nothing is invented where it has nothing."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest

import collalign
from collalign.output.loading import load
from collalign.tools.transfer.result import CARRIED, MISSING_PLACE
from data_tools.datasets.synthetic import deformed_family
from data_tools.datasets.synthetic_shapes import crown
from data_tools.errors import CollectionError
from data_tools.io.shapes import read_shape, write_mesh
from data_tools.landmark_files import Landmarks
from data_tools.options import SamplingOptions
from data_tools.rotations import random_rotation
from data_tools.surface.topology import boundary_edges
from tests.commands import read_rows, run_command
from tests.finished_runs import radius
from tests.pairwise.test_partial_match import cut, moved
from tests.view_problems import write_result

NUM_SHAPES, BROKEN = 5, "tooth3"
#: Vertices with landmarks; the cut takes some of them.
LANDMARKS = np.arange(10, 480, 30)


class Teeth:
    """Broken and whole teeth in known correspondence, aligned and saved, and their dense correspondence."""

    def __init__(self, folder):
        rng = np.random.default_rng(5)
        teeth = deformed_family(crown(rng, num_vertices=500), NUM_SHAPES, rng, rms=0.01)
        (folder / "shapes").mkdir()
        self.whole = {}
        for number, tooth in enumerate(teeth):
            name, turn = f"tooth{number}", random_rotation(rng)
            scale, shift = rng.uniform(0.7, 1.5), rng.standard_normal(3)
            part = cut(tooth, np.array([1.0, 0.4, 0.2]), 0.3) if name == BROKEN else tooth
            write_mesh(folder / "shapes" / f"{name}.ply", moved(part, turn, scale, shift))
            self.whole[name] = moved(tooth, turn, scale, shift).vertices
        options = collalign.AlignOptions(
            group="SO",
            incomplete=BROKEN,
            sampling=SamplingOptions(num_points=24, num_dense_points=200),
        )
        self.result = folder / "result"
        aligned = collalign.align_collection(
            folder / "shapes", options=options, jobs=1, progress=False
        )
        aligned.save(self.result, report=False)
        left = read_shape(folder / "shapes" / f"{BROKEN}.ply")
        self.broken, self.broken_faces = left.vertices, left.faces
        self.run = collalign.RunOptions(jobs=1, store=folder / "store.sqlite")
        self.dense = collalign.maps.dense_correspondence(self.result, run=self.run, progress=False)

    @property
    def size(self):
        """Root mean square radius of the broken tooth as it was."""
        return radius(self.whole[BROKEN])

    def lost(self, vertices):
        """Distance of vertices of the broken tooth, as it was, from what is left of it, in radii."""
        gaps = np.linalg.norm(vertices[:, None] - self.broken, axis=2).min(axis=1)
        return np.asarray(gaps / self.size)

    def inside(self, vertices):
        """Whether vertices of the broken tooth, as it was, are left and farther than .1 radii from any rim."""
        rim = self.broken[np.unique(boundary_edges(self.broken_faces))]
        gaps = np.linalg.norm(vertices[:, None] - rim, axis=2).min(axis=1) / self.size
        return np.asarray((gaps > 0.1) & (self.lost(vertices) < 1e-6))


@pytest.fixture(scope="module")
def teeth(tmp_path_factory):
    return Teeth(tmp_path_factory.mktemp("teeth"))


def to_file(teeth, points):
    """Take points of the common frame to the broken tooth's file."""
    view = load(teeth.result)
    inverse = np.linalg.inv(view.transforms[view.index(BROKEN)])
    return np.asarray(points @ inverse[:3, :3].T + inverse[:3, 3])


def test_dense_correspondence_has_no_place_where_the_shape_has_nothing(teeth):
    dense, row = teeth.dense, teeth.dense.names.index(BROKEN)
    assert dense.missing.any(axis=1).tolist() == [name == BROKEN for name in dense.names]
    assert 0.15 < dense.missing[row].mean() < 0.5
    assert np.isnan(dense.residual[dense.missing]).all()
    assert (dense.quality[dense.missing] == 0).all()
    lost = teeth.lost(to_file(teeth, dense.completed[row]))
    assert (dense.missing[row] == (lost > 0.2))[(lost < 0.1) | (lost > 0.3)].mean() > 0.97
    assert np.isfinite(dense.mean).all()
    guessed = to_file(teeth, dense.completed[row][dense.missing[row]])  # near what was cut off
    gaps = np.linalg.norm(guessed[:, None] - teeth.whole[BROKEN], axis=2).min(axis=1) / teeth.size
    assert np.median(gaps) < 0.15
    assert np.isfinite(dense.completed).all()


def test_landmarks_are_not_carried_to_what_is_missing(teeth, tmp_path):
    labels = tuple(f"p{at}" for at in LANDMARKS)
    given = {
        name: Landmarks(labels=labels, points=teeth.whole[name][LANDMARKS])
        for name in ("tooth0", "tooth1", "tooth4")
    }
    found = collalign.landmarks.transfer_landmarks(
        teeth.result, given, run=teeth.run, progress=False
    )
    row = found.names.index(BROKEN)
    lost = teeth.lost(teeth.whole[BROKEN][LANDMARKS])
    missing = np.array([status == MISSING_PLACE for status in found.status[row]])
    inside = teeth.inside(teeth.whole[BROKEN][LANDMARKS])
    assert missing[lost > 0.25].all()
    assert (lost > 0.25).sum() >= 2
    assert not missing[inside].any()
    assert inside.sum() >= 5
    assert (np.isnan(found.points[row]).any(axis=1) == missing).all()
    assert np.isnan(found.radii[row][missing]).all()
    kept = (
        np.linalg.norm(found.points[row] - teeth.whole[BROKEN][LANDMARKS], axis=1)[~missing]
        / teeth.size
    )
    assert np.median(kept) < 0.15
    assert found.status[found.names.index("tooth2")] == (CARRIED,) * len(labels)


def test_broken_and_doubtful_shapes_are_left_out_unless_asked_for_and_too_few_have_no_variation(
    teeth, tmp_path
):
    view = load(teeth.result)
    result = tmp_path / "result"
    shutil.copytree(teeth.result, result)
    doubted = next(name for name in view.names if name != BROKEN)
    write_result(
        replace(view, confidence=np.where(np.array(view.names) == doubted, 0.5, 0.99)), result
    )
    command = ["variation", str(result), "--store", str(teeth.run.store), "--jobs", "1"]
    assert f"Left out of the statistics: {doubted} (in doubt)" in run_command(*command).err
    assert f"{BROKEN},incomplete" in (result / "variation" / "left_out.csv").read_text().split()
    scored = {line["name"] for line in read_rows(result / "variation" / "scores.csv")}
    assert {doubted, BROKEN}.isdisjoint(scored)
    (tmp_path / "labels.csv").write_text(
        "\n".join(["name,kind", *(f"{name},a" for name in view.names)]) + "\n"
    )
    classify = [
        "variation",
        str(result),
        "--labels",
        str(tmp_path / "labels.csv"),
        "--classify",
        "kind",
        "--json",
    ]
    found = json.loads(run_command(*classify).out)
    assert (found["scored"], set(found["left_out"])) == (NUM_SHAPES - 2, {doubted, BROKEN})
    found = json.loads(
        run_command(*classify, "--include-doubtful", "--exclude", doubted, BROKEN).out
    )
    assert (found["scored"], {*found["left_out"].values()}) == (
        NUM_SHAPES - 2,
        {"excluded"},
    )
    write_result(replace(view, confidence=np.full(len(view), 0.5)), result)
    with pytest.raises(
        CollectionError, match="0 shapes are complete and sure, at least 2 are needed"
    ):
        collalign.statistics.write_surface_variation(result, tmp_path / "out", progress=False)
