"""Faults in what shapes are and how they are read (:mod:`data_tools`), and in measuring (:mod:`experiments`)."""

from tests.mutants.place import Table

FAULTS: Table = {
    ("data_tools/arrays.py", "data_tools/test_arrays.py"): [
        ("as_floats", "np.isfinite(array)", "~np.isnan(array)"),
        ("as_weights", "(array < 0).any()", "(array < -1).any()"),
        ("as_rotations", "if not error <= ORTHOGONAL_TOL", "if not error <= 1e3 * ORTHOGONAL_TOL"),
    ],
    ("data_tools/checks.py", "data_tools/test_checks.py"): [
        ("check_number", "positive and value == lower", "False"),
    ],
    ("data_tools/embedding/sampling.py", "data_tools/embedding/test_sampling.py"): [
        ("_choose", "np.minimum(nearest, distance_from(index), out=nearest)", "nearest[:] = distance_from(index)"),
        ("_choose", "if nearest[index] <= 0:", "if False:"),
        ("central_extreme", "points - points.mean(axis=0)", "points"),
    ],
    ("data_tools/io/csv_cells.py", "data_tools/io/test_csv_cells.py"): [
        ("_cell", "not _is_number(value)", "True"),
        ("_cell", 'return ""', 'return "nan"'),
        ("plain_cell", " and _FORMULA.match(cell)", ""),
    ],
    ("data_tools/io/headers.py", "data_tools/io/test_headers.py"): [
        ("check_ply", "found < needed", "found < needed - 1"),
        ("check_stl", "3 * num_ends", "num_vertices"),
        ("check_stl", ' or b"endsolid" not in lower', ""),
        ("check_stl", "84 + 50 *", "84 + 0 *"),
        ("_ply_elements", "total + _PLY_SIZES.get(kind, 1)", "_PLY_SIZES.get(kind, 1)"),
        ("_ply_elements", 'words[2] if words[1] == "list" else words[1]', "words[1]"),
    ],
    ("data_tools/io/mesh_formats.py", "data_tools/io/test_headers.py"): [
        ("_part", "faces = faces[:, ::-1]", "pass"),
        ("_concatenate", "f + start for", "f for"),
    ],
    ("data_tools/io/output_folder.py", "data_tools/io/test_output_folder.py"): [
        ("refuse_overlap", "contains or inside:", "contains:"),
        ("OutputFolder.refuse_foreign", 'writer.split(" ")[0] != self._writer.split(" ")[0]', "False"),
        ("output_path", "if not resolved(path.parent).is_relative_to(resolved(folder)):", "if False:"),
        ("OutputFolder.publish", "if complete and", "if"),
        ("OutputFolder._is_ours", "path.is_symlink() or ", ""),
        ("file_stems", "taken.add(stem.casefold())", "taken.add(stem)"),
    ],
    ("data_tools/io/pcd.py", "data_tools/io/test_headers.py"): [
        ("_from_text", "int(starts[fields.index(axis)])", "fields.index(axis)"),
        ("_from_binary", "if len(body) < num * record.itemsize:", "if False:"),
    ],
    ("data_tools/io/source.py", "data_tools/io/test_headers.py"): [
        ("sibling_path", "if found.parent != folder:", "if False:"),
    ],
    ("data_tools/io/text_tables.py", "data_tools/io/test_text_tables.py"): [
        ("parse_table", "len(values) == counts.sum()", "True"),
        ("filled_lines", "starts[counts > 0]", "starts"),
    ],
    ("data_tools/poses.py", "data_tools/test_poses.py"): [
        ("moved_by", "transform[:3, :3].T +", "transform[:3, :3] +"),
        ("Similarity.undo", ") @ self.rotation", ") @ np.swapaxes(self.rotation, -1, -2)"),
        ("turn_deg", "nan=180.0", "nan=0.0"),
        ("keep_apart", "> least_deg", ">= 0.0"),
    ],
    ("data_tools/rotations.py", "data_tools/test_rotations.py"): [
        ("chordal_angles", "np.sqrt(8.0)", "np.sqrt(4.0)"),
        (
            "rotation_angles",
            "np.where(opposite, np.pi, chordal_angles(first, second))",
            "chordal_angles(first, second)",
        ),
        ("nearest_orthogonal", "u[..., -1] *=", "u[..., 0] *="),
        ("random_rotation", 'group == "SO" and ', ""),
    ],
    ("data_tools/surface/cleaning.py", "data_tools/surface/test_cleaning.py"): [
        ("_places", "(vertices == vertices[first[place]]).all()", "True"),
        ("_drop_degenerate", "good[doubtful] =", "_ ="),
        ("_hashes", "bits ^ (bits >> np.uint64(32))", "bits"),
    ],
    ("data_tools/surface/decimation.py", "data_tools/surface/test_decimation.py"): [
        ("_clustered", "inside = cell[first] == cell[second]", "inside = cell[first] >= 0"),
        ("_clustered", "% 2 == 1", "> 0"),
    ],
    ("data_tools/surface/outliers.py", "data_tools/surface/test_outliers.py"): [
        ("without_outliers", "nearest[faces]", "faces"),
        ("_last_after_gap", "FAR_RATIO * last", "last"),
        ("_out_of_place", "(np.bincount(group) <= MAX_FAR_CONNECTED)", "True"),
        ("_out_of_place", "(spread <= MAX_RING_SHARE * radius)", "True"),
    ],
    ("experiments/ground_truth.py", "experiments/test_ground_truth.py"): [
        ("landmark_rotation", '1.0 if group == "SO" else None', "None"),
        ("landmark_rotation", "~(np.isnan(q).any(axis=1) | np.isnan(p).any(axis=1))", "~np.isnan(q).any(axis=1)"),
        ("read_symmetry", "partner[pair] = pair[::-1]", "partner[pair] = pair"),
    ],
    ("experiments/maps/graph_operator.py", "collalign/nonrigid/test_nonrigid_evidence.py"): [
        ("graph_spectrum", "weights = np.maximum(weights, weights.T)", "weights = weights.T"),
        ("graph_spectrum", "4.0 * np.pi * num", "np.pi * num"),
        ("_weights", "/ GAUSSIAN_WIDTH**2", "/ GAUSSIAN_WIDTH"),
    ],
    ("experiments/maps/paper_chain.py", "experiments/test_paper_chain.py"): [
        ("icp", "while change > _SETTLED", "while change > 1e3"),
        ("icp_map", "c_source_target[1:, 1:] = found.C_source_target", "pass"),
    ],
}
