"""Faults in what is said of incomplete shapes: margins that were not earned, marks that lack."""

from tests.mutants.place import Mutant, faults

_MISSING = ("tests/end_to_end/test_missing_regions.py",)

INCOMPLETE: tuple[Mutant, ...] = (
    *faults(
        "collalign/confidence/overlap_model.py",
        ("tests/collalign/confidence/test_overlap_model.py",),
        ("rival_margin", "(means[apart] - means[0]).min", "(means[apart] - means[0]).max"),
        ("rival_margin", "> AGREE_DEG", "> 0.0"),
        ("certainty", "np.sqrt(num_targets)", "1.0"),
    ),
    *faults(
        "collalign/registration/missing.py",
        _MISSING,
        ("missing_vertices", "(places.weights <= 0.0)", "(places.weights <= 1.0)"),
        ("mean_of_what_is_there", "np.where((total > 0)[:, None], mean, source)", "source"),
    ),
    *faults(
        "collalign/output/report/coverage.py",
        ("tests/collalign/output/test_report_incomplete.py",),
        ("_missing_part", "lacks = ~own.has(carried)", "lacks = own.has(carried)"),
        ("_typical", "if not collection.is_incomplete[i]", "if True"),
    ),
)
