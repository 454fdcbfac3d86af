"""Faults in left and right, in semilandmarks of curves, and in what landmarks may not be carried to."""

from tests.mutants.place import Mutant, faults

SURFACES: tuple[Mutant, ...] = (
    *faults(
        "collalign/analysis/symmetry.py",
        ("tests/collalign/analysis/test_symmetry.py",),
        ("mirror_image", "points[..., partner, :] * _MIRROR", "points * _MIRROR"),
        ("mirror_normal", "vectors[:, 0]", "vectors[:, 2]"),
        ("_anova", "3 * num_pairs + num_middle - 3", "3 * num_pairs - 3"),
        ("_exchange_test", ">= found", "< found"),
        ("_group_means", "sums / counts[:, None, None]", "sums"),
    ),
    *faults(
        "data_tools/surface/cleaning.py",
        ("tests/data_tools/surface/test_cleaning.py",),
        ("_places", "(vertices == vertices[first[place]]).all()", "True"),
        ("_drop_degenerate", "good[doubtful] =", "_ ="),
        ("_hashes", "bits ^ (bits >> np.uint64(32))", "bits"),
    ),
    *faults(
        "data_tools/surface/outliers.py",
        ("tests/data_tools/surface/test_outliers.py",),
        ("without_outliers", "nearest[faces]", "faces"),
        ("_last_after_gap", "FAR_RATIO * last", "last"),
        ("_out_of_place", "(np.bincount(group) <= MAX_FAR_CONNECTED)", "True"),
        ("_out_of_place", "(spread <= MAX_RING_SHARE * radius)", "True"),
    ),
    *faults(
        "data_tools/surface/decimation.py",
        ("tests/data_tools/surface/test_decimation.py",),
        ("_clustered", "inside = cell[first] == cell[second]", "inside = cell[first] >= 0"),
        ("_clustered", "% 2 == 1", "> 0"),
    ),
    *faults(
        "data_tools/surface/normals.py",
        ("tests/data_tools/surface/test_normals.py",),
        ("outward_normals", "any(axis=1)", "all(axis=1)"),
    ),
    *faults(
        "data_tools/io/text_tables.py",
        ("tests/data_tools/io/test_text_tables.py",),
        ("parse_table", "len(values) == counts.sum()", "True"),
        ("filled_lines", "starts[counts > 0]", "starts"),
    ),
    *faults(
        "collalign/tools/variation/mirror.py",
        ("tests/collalign/tools/test_mirror.py",),
        ("mirror_map", "unlikeness > MOST_UNLIKE", "False"),
        ("mirror_map", "values.argmin()", "values.argmax()"),
    ),
    *faults(
        "collalign/landmarks/on_surface.py",
        ("tests/collalign/landmarks/test_placement.py",),
        ("place_templates", "declared or _system_on(marks, surface)", "declared"),
        ("place_templates", "if system and not declared else set()", "if system else set()"),
        ("_system_on", "off > SURE and ", ""),
        ("_check", "off > FAR or ", ""),
        ("_check", "crowded and near <= SURE", "False"),
        ("_Surface.distances", "found - self._slack", "found"),
        ("_converted", "one.points * LPS_RAS", "one.points"),
    ),
    *faults(
        "collalign/landmarks/curves.py",
        ("tests/collalign/landmarks/test_curves.py",),
        ("evenly_spaced", "endpoint=not closed", "endpoint=True"),
        ("counting_like", "np.argmin(gaps)", "np.argmax(gaps)"),
        ("slider_rows", "[*rows, rows[0]] if closed", "rows if closed"),
    ),
    *faults(
        "collalign/confidence/radius_model.py",
        ("tests/collalign/confidence/test_radius_model.py",),
        ("beyond_range", "max(calibration.most_residual, _LEAST_RANGE)", "_LEAST_RANGE"),
    ),
    *faults(
        "collalign/tools/correspond/run.py",
        ("tests/end_to_end/test_transfer.py",),
        ("_of_unit_size", "centred / radius if radius > 0 else centred", "centred"),
    ),
    *faults(
        "collalign/registration/start.py",
        ("tests/collalign/registration/test_start.py",),
        ("bent_by_map", "is_small or is_turned", "is_small"),
        ("bent_by_map", "< _LEAST_EXTENT", "< 0"),
        ("laid_by_map", "np.clip(1.0 - (distances / scale) ** 2, 0.0, 1.0) ** 2", "trust"),
        ("bent_by_map", "math.sqrt(target.area / source.area)", "1.0"),
    ),
    *faults(
        "collalign/registration/fit.py",
        ("tests/collalign/registration/test_fit.py",),
        ("fitted_by_map", "Shape.from_arrays(moved, source.faces, name=source.name)", "enlarged"),
        ("fitted_by_map", "math.sqrt(target.area / source.area)", "1.0"),
        ("_closest_points", "places=places[to]", "places=places[at]"),
        ("_closest_points", "cKDTree(theirs).query(ours)", "cKDTree(ours).query(theirs)"),
    ),
    *faults(
        "collalign/stages/deformation/places.py",
        ("tests/collalign/stages/test_deformation.py",),
        ("places_on_reference", ".on(to.vertices)", ".on(fitted)"),
        ("_goals", "np.arange(len(from_reference)), to_reference", "to_reference, np.arange(len(from_reference))"),
    ),
    *faults(
        "collalign/products/deformation.py",
        ("tests/collalign/stages/test_deformation.py",),
        ("VertexMaps.__getitem__", "len(self.places[b]), -1", "len(self.places[b]), 0"),
    ),
    *faults(
        "collalign/registration/pieces.py",
        ("tests/collalign/registration/test_start.py",),
        ("RigidPieces.turned_back", "eji,ej->ei", "eij,ej->ei"),
        ("RigidPieces.turned_edges", "eij,ej->ei", "eji,ej->ei"),
    ),
    *faults(
        "collalign/tools/correspond/map_starts.py",
        ("tests/end_to_end/test_transfer_bent.py",),
        ("map_starts", "return {}", "raise InputError(reference.name)"),
    ),
    *faults(
        "collalign/registration/mean.py",
        ("tests/collalign/registration/test_register.py",),
        ("medoid", "one_way + one_way.T", "-one_way"),
    ),
)
