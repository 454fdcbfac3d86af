"""Drawn faults that change no result, each with the reason; they do not count."""

# ruff: noqa: E501

#: By the text of the mutant.
EQUIVALENT = {
    "pairwise/certificates/verify_pm_sdp.py _quadratic_upper_bounds: '    gamma = 2.0 * (len(F) + 4) * _EPS' -> '    gamma = 2.0 * (len(F) + 5) * _EPS'": "a wider allowance for rounding stays sound",
    "pairwise/certificates/verify_pm_sdp.py _cost_lower_bounds: '            (d + 8)' -> '            (d + 9)'": "a wider allowance for rounding stays sound",
    "pairwise/certificates/certificate.py CertificateArrays.refuse_rest: '            names = \", \".join(sorted(map(str, self._unread))[:5])' -> '            names = \", \".join(sorted(map(str, self._unread))[:6])'": "how many names a message lists",
    "collalign/tools/certify/rounds.py Rounds.prove: '        for e in np.argsort(-(master.least() + most), kind=\"stable\").tolist():' -> '        for e in np.argsort(-(master.least() - most), kind=\"stable\").tolist():'": "the order in which pairs are proven",
    "collalign/template_landmarks/carry.py fuse: '    filled = np.where(weights[..., None] > 0, said, 0.0)' -> '    filled = np.where(weights[..., None] > 0, said, 1.0)'": "multiplied by a weight of zero",
    'collalign/engine/dask_cluster.py _one_line: \'    return " ".join(f"{type(error).__name__}: {error}".split())[:300]\' -> \'    return " ".join(f"{type(error).__name__}: {error}".split())[:301]\'': "how much of a message is shown",
    'collalign/tools/match/nonrigid.py NonrigidCandidate.orientation: \'        return "preserving" if value > 0 else "reversing"\' -> \'        return "preserving" if value >= 0 else "reversing"\'': "a measured orientation is never zero",
    "collalign/output/report/sections.py shape_map: '            \"linkage\": joined[:, :3].tolist(),' -> '            \"linkage\": joined[:, :4].tolist(),'": "the page reads three of the columns",
    "collalign/output/evidence_file.py shown_pair: '        rotations=np.ascontiguousarray(pair.rotations[kept, :3, :3]),' -> '        rotations=np.ascontiguousarray(pair.rotations[kept, :4, :3]),'": "rotations have three rows",
    "pairwise/certificates/verify_cells.py <module>: 'DEEPEST = 60' -> 'DEEPEST = 61'": "a depth that no proof reaches",
    "collalign/stages/trust/assess.py _votes: '    return float(((angles <= AGREE_DEG).sum() + PRIOR_VOTES) / (len(partners) + 2.0 * PRIOR_VOTES))' -> '    return float(((angles <= AGREE_DEG).sum() + PRIOR_VOTES) / (len(partners) + 2.0 / PRIOR_VOTES))'": "twice and half of one prior vote are counted alike",
    "collalign/registration/register.py gaussian_kernel: '    np.maximum(squares, 0.0, out=squares)' -> '    pass'": "squares are below zero by rounding only",
    "data_tools/rotations.py rotation_angle_deg: '    same_handed = np.linalg.det(first) * np.linalg.det(second) > 0' -> '    same_handed = np.linalg.det(first) * np.linalg.det(second) >= 0'": "determinants are 1 or -1",
    "collalign/output/report/content.py _run_key: '    return hashlib.sha256(names + np.round(collection.transforms, 9).tobytes()).hexdigest()[:32]' -> '    return hashlib.sha256(names + np.round(collection.transforms, 9).tobytes()).hexdigest()[:33]'": "how much of a digest is kept",
    "collalign/synchronization/clusters.py spectral_clusters: '    spread = 1.0 / np.sqrt(np.maximum(degree, LEAST_TYPICAL * max(degree.max(initial=0.0), 1e-300)))' -> '    spread = 1.0 / np.sqrt(np.maximum(degree, LEAST_TYPICAL / max(degree.max(initial=0.0), 1e-300)))'": "a guard against zero, whatever its size",
    "collalign/synchronization/graph.py PairGraph.of_candidates: '        most = max((len(energies) for _, energies in candidates), default=1)' -> '        most = max((len(energies) for _, energies in candidates), default=2)'": "without pairs there are no candidates, however many fit",
    "collalign/synchronization/hypotheses.py common_rotations: '    far = ((flat - np.eye(graph.dim)) ** 2).sum(axis=(1, 2)) > SAME_ROTATION' -> '    far = ((flat - np.eye(graph.dim)) ** 2).sum(axis=(1, 2)) >= SAME_ROTATION'": "no distance is exactly the limit",
    "pairwise/branch_and_bound/pose_lists.py list_poses: '        for search, found in zip(searches, cells, strict=True)' -> '        for search, found in zip(searches, cells, strict=False)'": "both lists have one entry for each search",
    "pairwise/branch_and_bound/pose_lists.py _regions: '                rotations=read_only(rotations[members] * search.signs),' -> '                rotations=read_only(rotations[members] / search.signs),'": "signs are 1 or -1",
    "pairwise/pm_sdp/steps.py _longest: '        if high - low <= _PRECISION * high:' -> '        if high - low < _PRECISION * high:'": "no interval is exactly as long as the precision",
    "pairwise/branch_and_bound/search.py RotationSearch.run: '        batch = int(np.clip(_BATCH_ENTRIES // per_cell, 1, _MOST_CELLS))' -> '        batch = int(np.clip(_BATCH_ENTRIES / per_cell, 1, _MOST_CELLS))'": "the conversion to int rounds down as well",
    "pairwise/branch_and_bound/search.py RotationSearch._settle: '        is_small = ~is_settled & (is_smallest | (cells.radii <= self._resolution_rad))' -> '        is_small = ~is_settled & (is_smallest | (cells.radii < self._resolution_rad))'": "no radius is exactly the resolution",
}
