"""Faults in what poses are made of and trusted by: synchronization, stages and fitted models."""

from tests.mutants.place import MODULE, Table

FAULTS: Table = {
    ("collalign/confidence/map_model.py", "collalign/nonrigid/test_nonrigid_evidence.py"): [
        ("Evidence.map_score", "2.0 * np.log(max(self.curvature, FLOOR))", "np.log(max(self.curvature, FLOOR))"),
        ("Evidence.map_score", "1.0 - abs(self.orientation)", "1.0 - self.orientation"),
    ],
    ("collalign/confidence/overlap_model.py", "collalign/confidence/test_overlap_model.py"): [
        ("rival_margin", "> AGREE_DEG", "> 0.0"),
        ("certainty", "np.sqrt(num_targets)", "1.0"),
    ],
    ("collalign/confidence/pose_model.py", "collalign/stages/test_trust.py"): [
        (MODULE, "TIED_LEAD = 0.02, 1.0", "TIED_LEAD = -9.0, 1.0"),
        (MODULE, "TIED_LEAD = 0.02, 1.0", "TIED_LEAD = 0.02, 99.0"),
        ("terms", "np.sqrt(votes * collection)", "votes"),
        ("terms", "LIMITS[:, 0], LIMITS[:, 1]", "-np.inf, np.inf"),
        ("probability", "np.minimum(1.0 / (1.0 + np.exp(-score)), MOST_CONFIDENT)", "1.0 / (1.0 + np.exp(-score))"),
        ("pose_confidence", "1.0 / (1.0 + ties)", "1.0 / np.maximum(ties, 1.0)"),
    ],
    ("collalign/confidence/radius_model.py", "collalign/confidence/test_radius_model.py"): [
        ("beyond_range", "max(calibration.most_residual, _LEAST_RANGE)", "_LEAST_RANGE"),
    ],
    ("collalign/confidence/side_model.py", "collalign/confidence/test_side_model.py"): [
        (MODULE, "MIN_SHAPES = 6", "MIN_SHAPES = 5"),
        ("Sides.are_clear", "self.median_all >= LEAST_ALL[0] + LEAST_ALL[1] / self.num_pairs", "True"),
        ("Sides.are_clear", "and self.median_between >= LEAST_BETWEEN[0] + LEAST_BETWEEN[1] / self.num_pairs", ""),
        ("Sides.are_clear", "and self.contradicted <= MOST_CONTRADICTED", ""),
        ("Sides.are_clear", "and self.balance >= LEAST_BALANCE", ""),
        ("Sides.are_obvious", "and self.num_pairs >= MANY_PAIRS", ""),
        ("Sides.are_suspected", "self.num_between > 0 and ", ""),
        ("preferences", "mirrored - plain", "plain - mirrored"),
        ("_smaller_sides", "> np.bincount(part)", "< np.bincount(part)"),
    ],
    ("collalign/products/deformation.py", "collalign/stages/test_deformation.py"): [
        ("VertexMaps.__getitem__", "len(self.places[b]), -1", "len(self.places[b]), 0"),
    ],
    ("collalign/products/pair.py", "collalign/test_collection.py"): [
        ("Pairs.of", "frozenset((names[pair.target], names[pair.source]))", "frozenset((names[pair.target],))"),
        ("Pairs.__getitem__", "if frozenset(which) not in self._places:", "if False:"),
    ],
    ("collalign/stages/deformation/places.py", "collalign/stages/test_deformation.py"): [
        ("places_on_reference", ".on(to.vertices)", ".on(fitted)"),
        ("_goals", "np.arange(len(from_reference)), to_reference", "to_reference, np.arange(len(from_reference))"),
    ],
    ("collalign/stages/poses/bent.py", "collalign/stages/test_bent_poses.py"): [
        ("first_samples", "samples.positions[:num].mean(axis=0)", "0.0"),
        ("bent_poses", "present * trust", "present * 1.0"),
        ("_nearest_map", "np.where(near, odds, -np.inf)", "odds"),
        ("_trust", "[:, 0], np.inf)", "[:, 0], 0.0)"),
    ],
    ("collalign/stages/poses/refinement.py", "collalign/stages/test_pose_refinement.py"): [
        (MODULE, "NUM_ROUNDS = 2", "NUM_ROUNDS = 1"),
        ("_weights", "np.median(energies)", "np.max(energies)"),
        ("local_pairs", "nx.minimum_spanning_edges", "nx.maximum_spanning_edges"),
        ("local_pairs", "[:num]", "[:0]"),
    ],
    ("collalign/stages/surface_gap.py", "collalign/stages/test_trust.py"): [
        ("surface_gap", "gaps.min(axis=0).mean() + gaps.min(axis=1).mean()", "2.0 * gaps.min(axis=0).mean()"),
    ],
    ("collalign/stages/trust/assess.py", "collalign/stages/test_trust.py"): [
        ("partners_of", "np.swapaxes(turns, 1, 2)", "turns"),
        ("partners_of", "(partner.energy, partner.shape)", "(-partner.energy, partner.shape)"),
        ("_votes", "<= AGREE_DEG", "<= 9.0 * AGREE_DEG"),
        ("_votes", "partner.poses[0]", "partner.poses[-1]"),
        ("_votes", ".sum() + PRIOR_VOTES)", ".sum())"),
        ("gather_trust", "cost[1:].mean(axis=1) / cost[0].mean()", "cost[0].mean() / cost[1:].mean(axis=1)"),
        ("gather_trust", "evidence[known, VOTES].mean()", "1.0"),
        ("with_trust", "np.minimum(confidence[doubted], ONE_OF_TWO)", "confidence[doubted]"),
        ("with_trust", "chances = (1.0 - confidence[i]) * ", "chances = "),
        ("with_trust", "confidence[list(constraints.fixed)] = 1.0", "pass"),
    ],
    ("collalign/stages/trust/rival_poses.py", "collalign/stages/test_trust.py"): [
        ("rival_poses", "if mirrored else []", "if True else []"),
        ("rival_poses", "~_near(poses, pose[None])[:, 0]", "np.ones(len(poses), dtype=bool)"),
        ("leads_over", "odds[0] - odds[1:]", "odds[1:] - odds[0]"),
        ("leads_over", "if are_copies and", "if"),
        ("leads_over", "if are_copies and partner.energy == 0.0 else", "if False else"),
        ("leads_over", "else own.min()", "else 0.0"),
        ("leads_over", "np.maximum(partner.log_odds, LEAST_LOG_ODDS)", "partner.log_odds"),
        ("_near", "np.deg2rad(APART_DEG)", "np.deg2rad(0.1 * APART_DEG)"),
        ("_representatives", "left &= ~near[best]", "left[best] = False"),
        ("pose_costs", "partner_pose.T @ pose", "partner_pose @ pose"),
    ],
    (
        "collalign/synchronization/clusters.py",
        "collalign/synchronization/test_synchronization_parts.py",
        "collalign/stages/test_pose_parts.py",
    ): [
        ("pair_affinity", "apart <= CLOSED", "apart >= CLOSED"),
        ("_aligned_parts", "turn @ poses[members]", "poses[members]"),
        ("spectral_clusters", "np.argsort(np.argsort(first))", "np.argsort(first)[::-1]"),
    ],
    (
        "collalign/synchronization/gauge.py",
        "collalign/synchronization/test_synchronization_parts.py",
        "collalign/synchronization/test_synchronization.py",
    ): [
        ("fix_gauge", "gauged[i] = given[i]", "pass"),
        ("fix_gauge", "reference if reference in members else members[0]", "members[0]"),
        ("principal_axes_gauge", "vectors[:, ::-1].T", "vectors.T"),
        ("principal_axes_gauge", "if np.linalg.det(axes) < 0:", "if False:"),
    ],
    (
        "collalign/synchronization/problem/graph.py",
        "collalign/synchronization/test_synchronization_parts.py",
        "collalign/synchronization/test_synchronization.py",
    ): [
        ("PairGraph.with_constraints", "np.where(present[edge], 0.0, -np.inf)", "0.0"),
    ],
    ("collalign/synchronization/problem/model.py", "collalign/synchronization/test_synchronization_parts.py"): [
        ("EdgeModel._volume", "1.0 if self.graph.pattern.special_blocks else 2.0", "1.0"),
        ("_fitted_noise", "graph.num_shapes - 1", "0.0"),
        ("EdgeModel.costs", "+ np.exp(floor - top)", ""),
        ("relative_weights", "FIXED_WEIGHT * scaled", "1e-3 * scaled"),
        ("relative_energies", "lowest / middle", "middle / lowest"),
        ("squared_distances", "2.0 * graph.dim - 2.0 * inner", "2.0 * graph.dim - inner"),
        ("_fitted_power", "0.5 * np.log(", "np.log("),
    ],
    (
        "collalign/synchronization/resolve.py",
        "collalign/synchronization/test_synchronization_parts.py",
        "collalign/synchronization/test_synchronization.py",
    ): [
        ("with_resolved", "is_known or ", ""),
        ("with_resolved", "energy <= MAX_ENERGY_RATIO *", "energy <= 100.0 * MAX_ENERGY_RATIO *"),
        ("disagreeing_pairs", "> SAME_POSE_RAD", "> 0.0 * SAME_POSE_RAD"),
    ],
    ("collalign/synchronization/solvers/averaging.py", "collalign/stages/test_bent_poses.py"): [
        ("average_frames", "SMALLEST_RESIDUAL_DEG / residuals", "1.0"),
        ("average_frames", "weights * SMALLEST", "SMALLEST"),
    ],
    (
        "collalign/synchronization/solvers/blockwise.py",
        "collalign/synchronization/test_synchronization_parts.py",
        "collalign/synchronization/test_synchronization.py",
    ): [
        ("refinement_weights", "share / variance**2", "share"),
        ("refinement_weights", "weights[graph.fixed] = FIXED_WEIGHT *", "weights[graph.fixed] = 1e-3 *"),
        ("robust_synchronization", "fixed[i].T for i in fixed", "fixed[i] for i in fixed"),
        ("connectivity_warnings", "if num_components == 1:", "if num_components >= 1:"),
    ],
    (
        "collalign/synchronization/solvers/signs.py",
        "collalign/synchronization/test_synchronization_parts.py",
        "collalign/synchronization/test_synchronization.py",
    ): [
        ("synchronize_signs", "own * own[0]", "own"),
    ],
    ("collalign/synchronization/solvers/turns.py", "collalign/synchronization/test_synchronization_parts.py"): [
        ("_modes", "<= SAME_TURN] = 0.0", "<= SAME_TURN] *= 1.0"),
        ("_directed_flips", "(turn.T, rate / 2.0)", "(turn, rate / 2.0)"),
        ("_turned_distances", "shared @ flip", "flip @ shared"),
        ("turn_costs", "np.where(left_out[:, :, None] | right_out[:, None], FORBIDDEN, costs)", "costs"),
    ],
}
