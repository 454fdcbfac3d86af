"""One consistent pose per shape from many pairs that are partly wrong, with certificates and doubts."""

from collalign.synchronization.result import PoseAlternative, SynchronizationResult, WeakCut
from collalign.synchronization.solve import synchronize
from collalign.synchronization.spectral import alternate_assignments

__all__ = ["PoseAlternative", "SynchronizationResult", "WeakCut", "alternate_assignments", "synchronize"]
