"""Drawn faults that change no result, each with the reason; they do not count."""

# ruff: noqa: E501

#: By the text of the mutant.
EQUIVALENT: dict[str, str] = {
    "pairwise/certificates/verify_pm_sdp.py _quadratic_upper_bounds: '    gamma = 2.0 * (len(F) + 4) * _EPS' -> '    gamma = 2.0 * (len(F) + 5) * _EPS'": "a wider allowance for rounding stays sound",
    "pairwise/certificates/verify_pm_sdp.py _cost_lower_bounds: '        error = (d + 8) * _EPS * (weights[j] * squares + np.abs(constant_cost[:, j]) + 2.0 * v_size[:, 0])' -> '        error = (d + 9) * _EPS * (weights[j] * squares + np.abs(constant_cost[:, j]) + 2.0 * v_size[:, 0])'": "a wider allowance for rounding stays sound",
    "data_tools/surface/closest.py SurfaceLocator.closest: '            left = np.flatnonzero(far[:, -1] < best.distances + reach) if num < len(group) else every[:0]' -> '            left = np.flatnonzero(far[:, -1] < best.distances + reach) if num < len(group) else every[:1]'": "a point that is asked for again gets the same answer",
    "pairwise/certificates/arrays.py CertificateArrays.refuse_rest: '            names = \", \".join(sorted(map(str, self._unread))[:5])' -> '            names = \", \".join(sorted(map(str, self._unread))[:6])'": "how many names a message lists",
    "pairwise/partial/match.py <module>: 'MANY_STEPS = (0.35,) * 3 + (0.3,) * 3 + (0.25,) * 4 + (None,) * 8' -> 'MANY_STEPS = (0.35,) * 3 + (0.3,) * 3 + (0.25,) * 4 + (None,) * 9'": "a tuned value: one more of the last, closest steps",
}
