"""The dual solver beside the CVXPY reference on many small problems: ``python -m tests.benchmarks.catalogue``."""

from __future__ import annotations

import argparse
import sys
import warnings

from hypothesis import HealthCheck, Phase, given, settings

from tests.relaxation_problems import Comparison, Variant, compare_with_reference, variants

#: Largest difference over the problem's scale.
TOL = 2e-5


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--num", type=int, default=200, help="number of problems")
    num = parser.parse_args().num
    results: list[tuple[Comparison, str]] = []

    @settings(
        max_examples=num,
        deadline=None,
        derandomize=True,
        database=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @given(variants())
    def run(variant: Variant) -> None:
        results.append((compare_with_reference(variant), variant.description))

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        run()
    wrong = [(fault, words) for result, words in results for fault in result.faults(TOL)]
    for fault, words in wrong:
        print(f"{fault}: {words}")
    plain = [result for result, _ in results if not result.may_exceed]
    print(f"{len(results)} problems, {len(results) - len(plain)} with an SO(2) block, {len(wrong)} faults")
    print(f"largest |value - reference| / scale: {max(abs(result.excess) for result in plain):.1e}")
    print(f"largest (value - bound) / scale:     {max(result.gap for result, _ in results):.1e}")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
