"""Evidence of pairs: what it prefers, when maps are asked, and bent figures that rigid evidence alone gets wrong."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from collalign.align import align_collection
from collalign.confidence.candidate_model import (
    EVIDENCE,
    candidate_chances,
    candidate_costs,
    evidence_score,
)
from collalign.engine.records import from_record
from collalign.engine.run_options import RunOptions
from collalign.nonrigid.pose_maps import PoseMapper, prepare_posed
from collalign.options import AlignOptions
from collalign.stages.evidence.candidates import (
    MAX_CANDIDATES,
    PoseWeigher,
    candidates_laid,
    distinct_weighed,
    laid_surfaces,
)
from collalign.stages.evidence.weigh import (
    BENT_ENERGY,
    CLOSING_CYCLES,
    PairEvidence,
    by_energy,
    closing_share,
    voted_poses,
    votes_of,
    wants_maps,
    weigh_doubtful_pairs,
    with_evidence,
)
from collalign.stages.poses.synchronize import pair_graph
from data_tools.datasets.synthetic import bent
from data_tools.datasets.synthetic_shapes import figure
from data_tools.embedding.embedding import sample_shape
from data_tools.errors import OptionsError
from data_tools.io.shapes import write_mesh
from data_tools.options import AS_STORED, EmbeddingOptions, SamplingOptions
from data_tools.rotations import random_rotation, rotation_angle_deg
from data_tools.surface.shape import Shape
from tests.products import pair_of, samples_at, shapes_of

#: Samples of shapes whose neighbourhoods are not described.
BARE = [samples_at(np.eye(3))] * 6


def a_pair(energies):
    rng = np.random.default_rng(0)
    return pair_of([random_rotation(rng) for _ in energies], energies, num_samples=5)


def a_record(num):
    rng = np.random.default_rng(1)
    return {
        "rotations": np.stack([random_rotation(rng) for _ in range(num)]),
        "maps": np.tile(np.arange(5, dtype=np.int32), (num, 1)),
        "evidence": rng.random((num, len(EVIDENCE))),
    }


@pytest.mark.parametrize("kind", range(6))
def test_every_disagreement_counts_against_a_pose(kind):
    evidence = np.full((2, len(EVIDENCE)), 0.2)
    evidence[1, kind] = 0.4
    better, worse = evidence_score(evidence)
    assert better > worse + 0.5


def test_no_kind_of_evidence_overrules_two_others():
    evidence = np.full((2, len(EVIDENCE)), 0.2)
    evidence[1, EVIDENCE.index("normals")] = 2.0
    evidence[0, [EVIDENCE.index("energy"), EVIDENCE.index("surface")]] = 0.25
    assert evidence_score(evidence)[1] > evidence_score(evidence)[0]
    farther = evidence.copy()
    farther[1, EVIDENCE.index("normals")] = 20.0
    np.testing.assert_array_equal(evidence_score(farther), evidence_score(evidence))


def test_unknown_evidence_says_nothing():
    evidence = np.full((2, len(EVIDENCE)), np.nan)
    evidence[:, 0] = 0.1, 0.2
    scores = evidence_score(evidence)
    assert np.isfinite(scores).all()
    assert scores[0] > scores[1]


def test_near_rotations_are_one_candidate_the_better_one():
    rng = np.random.default_rng(2)
    first = random_rotation(rng)
    nudge = Rotation.from_euler("z", 0.1).as_matrix()
    far = np.diag([-1.0, -1.0, 1.0])
    poses = [
        (r, np.arange(3), np.full(len(EVIDENCE), value))
        for r, value in ((first, 0.3), (first @ nudge, 0.2), (first @ far, 0.4))
    ]
    kept = distinct_weighed(poses)
    assert [evidence[0] for _, _, evidence in kept] == [0.2, 0.4]
    many = [(random_rotation(rng), *poses[0][1:]) for _ in range(100)]
    assert len(distinct_weighed(many)) == MAX_CANDIDATES


def test_mirrored_poses_are_proposed_only_where_they_may_be(tmp_path):
    shape, flip = figure(resolution=2), np.diag([-1.0, 1.0, 1.0, 1.0])
    two = [shape, shape.transformed(flip)]
    samples = [sample_shape(one, SamplingOptions(num_points=24), EmbeddingOptions()) for one in two]
    weigher = PoseWeigher(*samples, PoseMapper(*(prepare_posed(one) for one in two)))
    files = [
        {"path": tmp_path / f"{n}.ply", "name": f"{n}", "digest": None, "cleaning": AS_STORED}
        for n in (0, 1)
    ]
    for file, one in zip(files, two, strict=True):
        write_mesh(file["path"], one)
    surfaces = laid_surfaces(files, [shape.area] * 2)
    assert not laid_surfaces(files, [2.0 * shape.area] * 2)
    proper = weigher.candidates_from_signs(mirrored=False)
    assert {round(float(np.linalg.det(rotation))) for rotation, _, _ in proper} == {1}
    best = distinct_weighed(weigher.candidates_from_signs(mirrored=True))[0][0]
    assert rotation_angle_deg(best, flip[:3, :3]) < 10.0
    (asked,) = candidates_laid(*samples, surfaces, "O", best[None])
    assert rotation_angle_deg(asked[0], best) < 10.0


def test_maps_are_asked_where_pairs_match_badly():
    rigid, bending = a_pair([0.5 * BENT_ENERGY, 0.9]), a_pair([1.5 * BENT_ENERGY, 0.9])
    options = AlignOptions()
    assert not wants_maps(options, shapes_of(BARE), [rigid, rigid, bending])
    assert wants_maps(options, shapes_of(BARE), [rigid, bending, bending])
    assert wants_maps(replace(options, maps="always"), shapes_of(BARE), [rigid])
    assert not wants_maps(replace(options, maps="never"), shapes_of(BARE), [bending])
    assert not wants_maps(replace(options, synchronization="spectral"), shapes_of(BARE), [bending])
    assert not wants_maps(options, shapes_of(BARE, "all"), [bending])
    mixed = replace(options, maps="always", embedding=EmbeddingOptions(kind="xyz+lb"))
    with pytest.raises(OptionsError, match="maps"):
        wants_maps(mixed, shapes_of(BARE), [rigid])


def test_maps_are_not_asked_where_all_cycles_of_pairs_close():
    rng = np.random.default_rng(3)
    turns = [random_rotation(rng) for _ in range(6)]
    edges = list(itertools.combinations(range(6), 2))
    weak = [
        replace(
            a_pair([1.5 * BENT_ENERGY]), target=i, source=j, rotations=(turns[i].T @ turns[j])[None]
        )
        for i, j in edges
    ]
    assert closing_share(weak) == 1.0
    assert not wants_maps(AlignOptions(), shapes_of(BARE), weak)
    wrong = [
        replace(pair, rotations=pair.rotations @ np.diag([1.0, -1.0, -1.0])) for pair in weak[:3]
    ]
    assert closing_share([*wrong, *weak[3:]]) < CLOSING_CYCLES
    assert wants_maps(AlignOptions(), shapes_of(BARE), [*wrong, *weak[3:]])
    mirrored = [replace(pair, rotations=-pair.rotations) for pair in weak[:1]]
    assert closing_share([*mirrored, *weak[1:]]) < 1.0


def test_candidates_of_maps_follow_the_rigid_ones_and_alone_take_part():
    pair = with_evidence(a_pair([0.1, 0.2]), from_record(PairEvidence, a_record(3), "a - b"))
    assert len(pair.energies) == len(pair.log_odds) == len(pair.evidence) == 5
    np.testing.assert_array_equal(pair.log_odds[2:], evidence_score(pair.evidence[2:]))
    graph = pair_graph([pair, replace(by_energy(a_pair([0.1, 0.2])), source=2)], 3, "SO")
    assert graph.present.tolist() == [
        [False, False, True, True, True],
        [True, True, False, False, False],
    ]
    assert graph.best_choice.tolist() == [int(np.argmax(pair.log_odds)), 0]


def test_bent_figures_are_put_right_by_maps(tmp_path, monkeypatch):
    rng, turns = np.random.default_rng(5), []
    (folder := tmp_path / "figures").mkdir()
    for number in range(4):
        shape, turn = bent(figure(resolution=2), rng, angle=0.9), random_rotation(rng)
        write_mesh(
            folder / f"{number}.ply", Shape.from_arrays(shape.vertices @ turn.T, shape.faces)
        )
        turns.append(turn)
    options = AlignOptions(maps="always", group="SO")
    run = RunOptions(jobs=1, store=tmp_path / "store.sqlite")
    aligned = align_collection(folder, options=options, run=run)
    relative = [
        aligned.rotations[0].T @ pose @ turns[i] @ turns[0].T
        for i, pose in enumerate(aligned.rotations)
    ]
    assert max(rotation_angle_deg(turn, np.eye(3)) for turn in relative) < 25.0
    again = align_collection(folder, options=options, run=run)
    assert np.array_equal(aligned.rotations, again.rotations)
    assert all(np.isfinite(pair.log_odds).any() for pair in aligned.pairs)


def test_the_strongest_votes_are_rivals_and_tried_against_sure_partners(monkeypatch):
    rng = np.random.default_rng(7)
    poses = np.stack([random_rotation(rng) for _ in range(4)])
    flip = np.diag([-1.0, 1.0, -1.0])
    pairs = []
    for i in range(4):
        for j in range(i + 1, 4):
            right = poses[i].T @ poses[j]
            # The pairs of shape 3 but one know its flipped pose alone.
            own = right @ flip if j == 3 and i > 0 else right
            pairs.append(
                replace(
                    a_pair([0.1]), target=i, source=j, rotations=own[None], log_odds=np.zeros(1)
                )
            )
    rivals = voted_poses(votes_of(pairs, poses)[3], poses[3])
    assert rotation_angle_deg(rivals[1], poses[3] @ flip.T) < 1e-3
    found, laid = {2: from_record(PairEvidence, a_record(2), "0 - 3")}, {}
    weigh = "collalign.stages.evidence.weigh.weigh_starts"
    monkeypatch.setattr(weigh, lambda *given, **_: laid.update(given[3]) or found)
    settled = weigh_doubtful_pairs(None, None, pairs, poses, np.array([0.95, 0.95, 0.95, 0.5]))
    assert [e for e, pair in enumerate(pairs) if pair.source == 3] == list(laid)
    assert [len(pair.energies) for pair in settled] == [1, 1, 3, 1, 1, 1]
    np.testing.assert_allclose(
        rotation_angle_deg(laid[2][:2], poses[0].T @ poses[3]), [0.0, 180.0], atol=1e-3
    )


def costs_of(pair):
    return candidate_costs(pair.energies, pair.mismatches)


def test_chances_of_candidates_leave_room_for_none_and_do_not_depend_on_units():
    pair = a_pair([0.10, 0.11, 0.3])
    chances = candidate_chances(pair)
    assert np.argmax(chances) == 0
    assert 0.85 < chances.sum() < 0.95
    assert chances[0] / chances[1] == pytest.approx(1.1**24)
    np.testing.assert_allclose(
        candidate_chances(replace(pair, energies=7.0 * pair.energies)), chances
    )
    assert candidate_chances(a_pair([0.1]))[0] == pytest.approx(1.0 / (1.0 + np.exp(-2.35)))
    assert candidate_chances(a_pair([0.0, 0.0])) == pytest.approx([1.0 / (2.0 + np.exp(-2.35))] * 2)
    weighed = candidate_chances(replace(pair, log_odds=np.array([-np.inf, -3.0, -4.0])))
    assert weighed == pytest.approx([0.0, np.e * weighed[2], weighed[2]])


def test_the_paper_s_own_synchronization_takes_energies_alone():
    pair = replace(a_pair([0.10, 0.11]), mismatches=np.array([0.09, 0.03]))
    costly, published = (
        pair_graph([pair], 2, "SO", energies_alone=alone) for alone in (False, True)
    )
    np.testing.assert_array_equal(published.energies[0], pair.energies)
    np.testing.assert_array_equal(costly.energies[0], costs_of(pair))
