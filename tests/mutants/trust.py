"""Faults in what is said about the trust in poses (:mod:`collalign.stages.trust`)."""

from tests.mutants.place import MODULE, Mutant, faults

_TESTS = ("tests/collalign/stages/test_trust.py",)

TRUST: tuple[Mutant, ...] = (
    *faults(
        "collalign/confidence/pose_model.py",
        _TESTS,
        (MODULE, "0.6, -5.85", "0.6, 5.85"),
        (MODULE, "TIED_LEAD = 0.02, 1.0", "TIED_LEAD = -9.0, 1.0"),
        (MODULE, "TIED_LEAD = 0.02, 1.0", "TIED_LEAD = 0.02, 99.0"),
        ("terms", "np.sqrt(votes * collection)", "votes"),
        ("terms", "LIMITS[:, 0], LIMITS[:, 1]", "-np.inf, np.inf"),
        ("probability", "np.minimum(1.0 / (1.0 + np.exp(-score)), MOST_CONFIDENT)", "1.0 / (1.0 + np.exp(-score))"),
        ("pose_confidence", "1.0 / (1.0 + ties)", "1.0 / np.maximum(ties, 1.0)"),
        ("pose_confidence", "np.minimum(probability", "np.maximum(probability"),
    ),
    *faults(
        "collalign/stages/trust/assess.py",
        _TESTS,
        ("_votes", "<= AGREE_DEG", "<= 9.0 * AGREE_DEG"),
        ("_votes", "partner.poses[0]", "partner.poses[-1]"),
        ("_votes", ".sum() + PRIOR_VOTES)", ".sum())"),
        ("gather_trust", "cost[1:].mean(axis=1) / cost[0].mean()", "cost[0].mean() / cost[1:].mean(axis=1)"),
        ("gather_trust", "rises.min()", "rises.max()"),
        ("gather_trust", "evidence[known, VOTES].mean()", "1.0"),
        ("gather_trust", "leads[i].min()", "leads[i].max()"),
        ("partners_of", "np.swapaxes(turns, 1, 2)", "turns"),
        ("partners_of", "(partner.energy, partner.shape)", "(-partner.energy, partner.shape)"),
        ("partners_of", "-pair.log_odds if is", "pair.log_odds if is"),
        ("with_trust", "np.minimum(confidence[doubted], ONE_OF_TWO)", "confidence[doubted]"),
        ("with_trust", "-RIVAL_POWER *", "RIVAL_POWER *"),
        ("with_trust", "chances = (1.0 - confidence[i]) * ", "chances = "),
        ("with_trust", "np.argsort(-chances", "np.argsort(chances"),
        ("with_trust", "confidence[list(constraints.fixed)] = 1.0", "pass"),
    ),
    *faults(
        "collalign/stages/trust/rival_poses.py",
        _TESTS,
        ("rival_poses", "if mirrored else []", "if True else []"),
        ("rival_poses", "~_near(poses, pose[None])[:, 0]", "np.ones(len(poses), dtype=bool)"),
        ("rival_poses", "-SUPPORT_POWER *", "SUPPORT_POWER *"),
        ("leads_over", "odds[0] - odds[1:]", "odds[1:] - odds[0]"),
        ("leads_over", "if are_copies and", "if"),
        ("leads_over", "if are_copies and partner.energy == 0.0 else", "if False else"),
        ("leads_over", "else own.min()", "else 0.0"),
        ("leads_over", "np.maximum(partner.log_odds, LEAST_LOG_ODDS)", "partner.log_odds"),
        ("_near", "np.deg2rad(APART_DEG)", "np.deg2rad(0.1 * APART_DEG)"),
        ("_representatives", "left &= ~near[best]", "left[best] = False"),
        ("pose_costs", "partner_pose.T @ pose", "partner_pose @ pose"),
    ),
    *faults(
        "collalign/stages/surface_gap.py",
        _TESTS,
        ("point_gaps", "(2.0 - 2.0 * target[1]", "(2.0 + 2.0 * target[1]"),
        ("surface_gap", "gaps.min(axis=0).mean() + gaps.min(axis=1).mean()", "2.0 * gaps.min(axis=0).mean()"),
    ),
)
