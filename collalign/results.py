"""What results are made of: frozen classes with read-only arrays, for annotations and to look up attributes."""

from collalign.batch import BatchJob, BatchResult
from collalign.output.collection_data import AlignedShape
from collalign.output.members import Members, Selection
from collalign.products.kinds import Kind
from collalign.products.pair import AlignedPair, Alternative, Pair
from collalign.products.run_record import Made, RunRecord
from collalign.products.shapes import Excluded, ExtraMaterial, Incomplete, PosedFile
from collalign.products.trust import Trust
from collalign.tools.certify.result import CertifiedCollection, JointBound
from collalign.tools.match.in_part import PartialMatch, PartialPose
from collalign.tools.match.rigid import RigidMatch
from collalign.tools.stability.run import Stability
from data_tools.embedding.copies import Copies
from data_tools.io.output_folder import OutputFolder
from data_tools.notes import Note

__all__ = [
    "AlignedPair",
    "AlignedShape",
    "Alternative",
    "BatchJob",
    "BatchResult",
    "CertifiedCollection",
    "Copies",
    "Excluded",
    "ExtraMaterial",
    "Incomplete",
    "JointBound",
    "Kind",
    "Made",
    "Members",
    "Note",
    "OutputFolder",
    "Pair",
    "PartialMatch",
    "PartialPose",
    "PosedFile",
    "RigidMatch",
    "RunRecord",
    "Selection",
    "Stability",
    "Trust",
]
