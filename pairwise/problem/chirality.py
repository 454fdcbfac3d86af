"""A problem over O(d) as problems over SO(d): one for the source, one for its mirror image."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from data_tools.arrays import FloatArray
from data_tools.errors import OptionsError
from pairwise.problem.pattern import RotationPattern
from pairwise.problem.problem import Problem


def mirror(dim: int) -> FloatArray:
    """Return the reflection F, diagonal (d,), such that every reflection is a rotation times F: -I in odd d."""
    signs = -np.ones(dim)
    if dim % 2 == 0:
        signs[:-1] = 1.0
    return signs


def chiralities(problem: Problem) -> list[tuple[bool, Problem]]:
    """Split a problem over SO(d) or O(d) into problems over SO(d), ``(reflected, problem)``.

    The source of the reflected one is ``source * mirror(d)``, so that its R stands for ``R diag(mirror)``.

    Raises
    ------
    OptionsError
        If R has zeros, more than one rotation block or a dimension other than 2 and 3.
    """
    pattern, dim = problem.pattern, problem.dim
    if dim not in (2, 3) or not pattern.mask.all() or pattern.special_blocks not in ((), ((0, dim),)):
        raise OptionsError("this needs points in dimension 2 or 3 and a full matrix R in SO(d) or O(d)")
    proper = replace(problem, pattern=RotationPattern(pattern.mask, ((0, dim),)))
    if pattern.special_blocks:
        return [(False, proper)]
    return [(False, proper), (True, replace(proper, source=problem.source * mirror(dim)))]
