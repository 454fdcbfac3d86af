"""Faults drawn at random that no test noticed once."""

from tests.mutants.place import MODULE, faults

SURVIVORS = (
    *faults(
        "collalign/output/shape_files.py",
        ("tests/collalign/output/test_shape_files.py",),
        ("write_shapes", "min(num, _MAX_TILES)", "max(num, _MAX_TILES) // 2"),
        ("write_shapes", "num - 1, min", "num + 1, min"),
        ("write_shapes", '"drawn": i in drawn', '"drawn": i not in drawn'),
    ),
    *faults(
        "collalign/output/vertex_maps.py",
        ("tests/collalign/output/test_shape_files.py",),
        ("PlaceColours.of_file", "self._high - self._low", "self._high + self._low"),
        ("PlaceColours.of_file", "extent > 0, extent, 1.0", "extent > 0, 1.0, extent"),
        ("PlaceColours.of_file", "name not in", "name in"),
    ),
    *faults(
        "collalign/synchronization/problem/model.py",
        ("tests/collalign/synchronization/test_synchronization_parts.py",),
        ("_fitted_candidates", "or not features.any()", "or features.any()"),
    ),
    *faults(
        "collalign/synchronization/solvers/blockwise.py",
        ("tests/collalign/synchronization/test_synchronization_parts.py",),
        ("restricted", "start == index[0] and", "start == index[0] or"),
        ("restricted", "start == index[0]", "start != index[0]"),
        ("restricted", "index[-1] + 1", "index[-1] - 1"),
        ("restricted", "any(", "all("),
    ),
    *faults(
        "collalign/nonrigid/surface/tips.py",
        ("tests/collalign/nonrigid/test_harmonic.py",),
        ("Tips.of", "surface.agd[tips] / surface", "surface.agd[tips] * surface"),
        ("Tips.of", "surface.area**0.5", "surface.area**1.5"),
    ),
    *faults(
        "pairwise/pm_sdp/interior_point.py",
        ("tests/pairwise/pm_sdp/test_pm_sdp_interior_point.py",),
        ("_InteriorPoint._advance", "new_primal is None or", "new_primal is None and"),
        ("_InteriorPoint._advance", "new_dual is None or", "new_dual is None and"),
        ("_InteriorPoint._advance", "max(sizes) <", "max(sizes) >"),
    ),
    *faults(
        "data_tools/embedding/surface_points.py",
        ("tests/data_tools/embedding/test_surface_points.py",),
        ("cloud_rim", "RIM_NEIGHBOURS + 1", "RIM_NEIGHBOURS - 1"),
        ("cloud_rim", "min(RIM", "max(RIM"),
    ),
    *faults(
        "collalign/stages/poses/agreement.py",
        ("tests/collalign/stages/test_pose_parts.py",),
        ("resolve_pair", "start))[1])", "start))[2])"),
    ),
    *faults(
        "data_tools/io/text_tables.py",
        ("tests/data_tools/io/test_text_tables.py",),
        ("_cells", "skipinitialspace=True", "skipinitialspace=False"),
        ("_cells", "if rows[0] and not", "if rows[0] or not"),
    ),
    *faults(
        "collalign/synchronization/solvers/turns.py",
        ("tests/collalign/synchronization/test_synchronization_parts.py",),
        (MODULE, "8.0 * np.sin(np.deg2rad(15.0))", "8.0 * np.sin(np.deg2rad(30.0))"),
    ),
    *faults(
        "collalign/synchronization/clusters.py",
        ("tests/collalign/synchronization/test_synchronization_parts.py",),
        ("_typical_affinity", "LEAST_TYPICAL * max(", "LEAST_TYPICAL * min("),
    ),
    *faults(
        "collalign/synchronization/problem/model.py",
        ("tests/collalign/synchronization/test_synchronization_parts.py",),
        ("relative_energies", "middle <= 0.0", "middle < 0.0"),
    ),
    *faults(
        "collalign/tools/variation/surface_symmetry.py",
        ("tests/collalign/tools/test_variation.py",),
        ("_one_side", "> _OFF_PLANE", "<= _OFF_PLANE"),
        ("_one_side", "[:NUM_PAIRS]", "[: NUM_PAIRS + 1]"),
    ),
    *faults(
        "pairwise/partial/counterparts.py",
        ("tests/pairwise/partial/test_partial_match.py",),
        ("_apart", "4.0 - squared", "8.0 - squared"),
    ),
    *faults(
        "pairwise/problem/problem.py",
        ("tests/pairwise/problem/test_problem.py",),
        ("energy_scale", "(problem.source**2).sum(axis=1)", "(problem.source**2).max(axis=1)"),
        ("energy_scale", ".sum(axis=1).mean()", ".sum(axis=1).sum()"),
    ),
    *faults(
        "collalign/stages/trial.py",
        ("tests/collalign/test_batch.py",),
        ("later_work", "options.incomplete == AUTO", "options.incomplete != AUTO"),
    ),
    *faults(
        "collalign/output/verify.py",
        ("tests/collalign/output/test_verify.py",),
        ("_check_samples", "fits and 1.0", "fits or 1.0"),
    ),
)
