"""Statistics of shapes: how the surfaces of a result vary, and tests of arrays of landmarks."""

from collalign.analysis.integration import TwoBlockPLS, two_block_pls
from collalign.analysis.measurement_error import MeasurementError, measurement_error
from collalign.analysis.paired_sides import PairedSides, paired_sides
from collalign.analysis.procrustes import (
    PrincipalComponents,
    generalized_procrustes,
    principal_components,
)
from collalign.analysis.shape_tests import AnovaRow, procrustes_anova
from collalign.analysis.symmetry import ObjectSymmetry, object_symmetry
from collalign.tools.variation.run import write_surface_variation
from collalign.tools.variation.shape_model import ShapeTestOptions
from collalign.tools.variation.surface_variation import SurfaceQuality, SurfaceVariation

__all__ = [
    "AnovaRow",
    "MeasurementError",
    "ObjectSymmetry",
    "PairedSides",
    "PrincipalComponents",
    "ShapeTestOptions",
    "SurfaceQuality",
    "SurfaceVariation",
    "TwoBlockPLS",
    "generalized_procrustes",
    "measurement_error",
    "object_symmetry",
    "paired_sides",
    "principal_components",
    "procrustes_anova",
    "two_block_pls",
    "write_surface_variation",
]
