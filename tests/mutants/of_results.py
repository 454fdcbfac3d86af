"""Faults in what keeps, shows and uses a collection: engine, output, tools, maps and landmarks."""

from tests.mutants.place import MODULE, Table

FAULTS: Table = {
    ("collalign/analysis/ordination.py", "collalign/analysis/test_ordination.py"): [
        ("newick", "(height - low) / 2", "height / 2"),
    ],
    ("collalign/analysis/procrustes.py", "collalign/analysis/test_procrustes.py"): [
        ("best_rotations", "determinant=1.0", "determinant=None"),
        ("principal_components", "singular**2 / (len(points) - 1)", "singular**2 / len(points)"),
        ("PrincipalComponents.shape_at", "np.sqrt(self.variances[component])", "self.variances[component]"),
    ],
    ("collalign/analysis/symmetry.py", "collalign/analysis/test_symmetry.py"): [
        ("mirror_image", "points[..., partner, :] * _MIRROR", "points * _MIRROR"),
        ("mirror_normal", "vectors[:, 0]", "vectors[:, 2]"),
        ("_anova", "3 * num_pairs + num_middle - 3", "3 * num_pairs - 3"),
        ("_exchange_test", ">= found", "< found"),
        ("_group_means", "sums / counts[:, None, None]", "sums"),
    ],
    ("collalign/engine/jobs/job.py", "collalign/engine/test_session.py"): [
        ("Results.__getitem__", "if name in self.failures:", "if False:"),
        ("_looked_up", "tuple(_looked_up(item, table) for item in argument)", "argument"),
        ("table_of_stored", "asked | former", "asked"),
        ("table_of_stored", "None if asked is None or former is None else asked | former", "asked"),
    ],
    ("collalign/engine/jobs/local.py", "collalign/engine/test_jobs_guard.py"): [
        ("_LocalRun._alone", "deaths, stalls = 1, 0", "deaths, stalls = 0, 0"),
        ("_too_often", "deaths >= _MAX_DEATHS_KILLED", "deaths >= 1"),
    ],
    ("collalign/engine/jobs/worker.py", "collalign/engine/test_jobs_guard.py"): [
        ("describe", "if isinstance(error, CollalignError):", "if False:"),
    ],
    ("collalign/engine/store/keys.py", "collalign/engine/test_keys.py"): [
        ("fingerprint", '"content": list(content_hashes)', '"content": sorted(content_hashes)'),
        ("fingerprint", '"version": algorithm_version, ', ""),
        ("pair_seed", "(target, source)", "sorted((target, source))"),
        ("_canonical", "value.is_integer() and", "False and"),
    ],
    ("collalign/engine/store/store.py", "collalign/engine/test_store.py"): [
        ("Store.put", 'connection.execute("DELETE FROM failures', 'str("DELETE FROM failures'),
        ("Store.get", "or digest != _digest(kind, key, data)", ""),
        ("Store.require", "if record is None:", "if False:"),
    ],
    ("collalign/engine/store/typed.py", "collalign/engine/test_typed.py"): [
        ("to_record", ' if field.name != "name"', ""),
        ("_checked", "None if value is None else ", ""),
        ("_checked", "if _instance(str, value, name) not in hint.__members__:", "if False:"),
        ("_instance", "type(value) is not kind", "False"),
        ("_number", "and not holds.nan", "and False"),
        ("_number", "if holds.positive and", "if False and"),
        ("_array", "as_rotations(array, name) if holds.rotations else array", "array"),
        ("_array", "lower=holds.lower", "lower=-MAX_INDEX"),
        ("_array", "sizes[word] = length", "pass"),
    ],
    ("collalign/landmarks/curves.py", "collalign/landmarks/test_curves.py"): [
        ("evenly_spaced", "endpoint=not closed", "endpoint=True"),
        ("slider_rows", "[*rows, rows[0]] if closed", "rows if closed"),
    ],
    ("collalign/landmarks/on_surface.py", "collalign/landmarks/test_placement.py"): [
        ("place_templates", "declared or _system_on(marks, surface)", "declared"),
        ("place_templates", "if system and not declared else set()", "if system else set()"),
        ("_system_on", "off > SURE and ", ""),
        ("_check", "off > FAR or ", ""),
        ("_check", "crowded and near <= SURE", "False"),
        ("_Surface.distances", "found - self._slack", "found"),
        ("_converted", "one.points * LPS_RAS", "one.points"),
    ],
    ("collalign/nonrigid/harmonic.py", "collalign/nonrigid/test_harmonic.py"): [
        ("_Side.carried", "self.basis[from_other]", "self.basis[to_other]"),
        ("_Side.carried", "smoothness * self.frequencies", "0.0 * self.frequencies"),
        ("HarmonicRefiner._nearest", "self._target, forward, backward", "self._target, backward, forward"),
    ],
    ("collalign/nonrigid/map_evidence.py", "collalign/nonrigid/test_harmonic.py"): [
        ("_stretch", "images[neighbours[:, 1:]] - images[:, None]", "images[neighbours[:, :1]] - images[:, None]"),
    ],
    ("collalign/nonrigid/map_evidence.py", "collalign/nonrigid/test_nonrigid_evidence.py"): [
        (
            "_commutativity_gap",
            "left, right = of_source[:, None] * c, c * of_target",
            "left, right = of_target[:, None] * c, c * of_source",
        ),
        ("_curvature_gap", "1.0 - correlations.mean()", "correlations.mean()"),
        ("paired_forms", "sign * pulled", "pulled"),
    ],
    ("collalign/nonrigid/starts/masks.py", "collalign/nonrigid/test_nonrigid_evidence.py"): [
        ("candidate_mask", "min(1.0, 1.5 * share)", "min(1.0, 4.5 * share)"),
        ("wave_gaps", "np.abs(differences).mean(axis=2)", "np.abs(differences).max(axis=2)"),
    ],
    ("collalign/nonrigid/starts/matched_tips.py", "collalign/nonrigid/test_harmonic.py"): [
        ("tip_matchings", "LEFT_OUT * (s - 1)", "LEFT_OUT"),
        ("tip_matchings", "added[known, at[known]] = np.inf", "pass"),
        ("tip_matchings", "- source.remoteness) ** 2", "- source.remoteness)"),
    ],
    ("collalign/nonrigid/surface/tips.py", "collalign/nonrigid/test_harmonic.py"): [
        ("Tips.of", "surface.area**0.5", "surface.area**1.5"),
    ],
    ("collalign/output/evidence/members.py", "collalign/output/test_report_content.py"): [
        ("statistics_members", "if not include_doubtful and known.any():", "if known.any():"),
        ("statistics_members", "and known.any()", ""),
        ("statistics_members", ">= DOUBT", ">= 0.1 * DOUBT"),
        ("statistics_members", "if not include_incomplete:", "if False:"),
        ("statistics_members", "if one_part:", "if False:"),
    ],
    ("collalign/output/report/coverage.py", "collalign/output/test_report_incomplete.py"): [
        ("_missing_part", "lacks = ~own.has(carried)", "lacks = own.has(carried)"),
        ("_typical", "if not collection.is_incomplete[i]", "if True"),
    ],
    ("collalign/output/shape_files.py", "collalign/output/test_shape_files.py"): [
        ("write_shapes", "min(num, _MAX_TILES)", "max(num, _MAX_TILES) // 2"),
    ],
    ("collalign/output/verify.py", "collalign/output/test_verify.py"): [
        (MODULE, "_SAMPLE_TOL = 1e-6", "_SAMPLE_TOL = 1e-1"),
        (MODULE, "_AREA_TOL = 0.05", "_AREA_TOL = 9.0"),
        ("_Result.problem", "group=self.group", 'group="SO"'),
        ("_Result.exceeds", "np.isfinite(limit) and ", ""),
        ("_check_pair", "certificate, problem=problem)", "certificate)"),
        ("_check_pair", "value, energy, target", "bound, energy, target"),
        ("_check_samples", '"none": 1.0', '"none": size / float(np.linalg.norm(matched))'),
        ("Verification.num_proven", "pair.proven >= _PROVEN_SHARE * pair.stated", "True"),
        ("_pair_rows", "if ends in rows or", "if False and"),
        ("_pair_rows", 'plain_cell(row["target"])', 'row["target"]'),
    ],
    ("collalign/output/vertex_maps.py", "collalign/output/test_shape_files.py"): [
        ("PlaceColours.of_file", "extent > 0, extent, 1.0", "extent > 0, 1.0, extent"),
    ],
    ("collalign/registration/fit.py", "collalign/registration/test_fit.py"): [
        ("fitted_by_map", "Shape.from_arrays(moved, source.faces, name=source.name)", "enlarged"),
        ("fitted_by_map", "math.sqrt(target.area / source.area)", "1.0"),
        ("_closest_points", "places=places[to]", "places=places[at]"),
        ("_closest_points", "cKDTree(theirs).query(ours)", "cKDTree(ours).query(theirs)"),
    ],
    ("collalign/registration/mean.py", "collalign/registration/test_register.py"): [
        ("medoid", "one_way + one_way.T", "-one_way"),
    ],
    ("collalign/registration/missing.py", "end_to_end/test_missing_regions.py"): [
        ("mean_of_what_is_there", "np.where((total > 0)[:, None], mean, source)", "source"),
    ],
    ("collalign/registration/pieces.py", "collalign/registration/test_start.py"): [
        ("RigidPieces.turned_back", "eji,ej->ei", "eij,ej->ei"),
        ("RigidPieces.turned_edges", "eij,ej->ei", "eji,ej->ei"),
    ],
    ("collalign/registration/start.py", "collalign/registration/test_start.py"): [
        ("bent_by_map", "is_small or is_turned", "is_small"),
        ("bent_by_map", "< _LEAST_EXTENT", "< 0"),
        ("laid_by_map", "np.clip(1.0 - (distances / scale) ** 2, 0.0, 1.0) ** 2", "trust"),
        ("bent_by_map", "math.sqrt(target.area / source.area)", "1.0"),
    ],
    ("collalign/tools/classify/run.py", "collalign/tools/test_classify.py"): [
        ("_nearest", "| ~known[None, :]", ""),
        ("classify_leave_one_out", 'counts[value] > 1 or singles == "count-wrong"', "True"),
        ("classify_leave_one_out", "(counts[values[at]] - 1) / others", "counts[values[at]] / others"),
    ],
    ("collalign/tools/correspond/map_starts.py", "end_to_end/test_transfer_bent.py"): [
        ("map_starts", "return {}", "raise InputError(reference.name)"),
    ],
    ("collalign/tools/correspond/run.py", "end_to_end/test_transfer.py"): [
        ("_of_unit_size", "centred / radius if radius > 0 else centred", "centred"),
    ],
    ("collalign/tools/export/tables.py", "collalign/tools/test_exports.py"): [
        ("_pairs", "names[pair.target] for pair", "names[pair.source] for pair"),
        ("_consensus", "np.maximum(counts, 1)", "len(known)"),
        ("_shapes", "centroid_sizes(collection).tolist()", "collection.scales.tolist()"),
    ],
    ("collalign/tools/variation/mirror.py", "collalign/tools/test_mirror.py"): [
        ("mirror_map", "unlikeness > MOST_UNLIKE", "False"),
    ],
    ("collalign/tools/variation/surface_symmetry.py", "collalign/tools/test_variation.py"): [
        ("_one_side", "> _OFF_PLANE", "<= _OFF_PLANE"),
        ("_one_side", "[:NUM_PAIRS]", "[: NUM_PAIRS + 1]"),
    ],
}
