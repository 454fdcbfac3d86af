"""What can be imported from ``collalign``, with every type that its signatures name: the package reads this list."""

import data_tools as data_tools
import pairwise as pairwise
from collalign.align import align_collection as align_collection
from collalign.analysis.procrustes import PrincipalComponents as PrincipalComponents
from collalign.confidence.map_model import Evidence as Evidence
from collalign.engine.run_options import RunOptions as RunOptions
from collalign.extend import add_to_collection as add_to_collection
from collalign.landmarks.templates import SemilandmarkRequest as SemilandmarkRequest
from collalign.nonrigid.map_options import NonrigidOptions as NonrigidOptions
from collalign.nonrigid.map_options import SurfaceOptions as SurfaceOptions
from collalign.options import AlignOptions as AlignOptions
from collalign.options import TwoShapeOptions as TwoShapeOptions
from collalign.output.aligned_shape import AlignedShape as AlignedShape
from collalign.output.collection import Collection as Collection
from collalign.output.evidence.loading import load as load
from collalign.output.evidence.members import Members as Members
from collalign.products.consistent_maps import ConsistentMaps as ConsistentMaps
from collalign.products.deformation import VertexMaps as VertexMaps
from collalign.products.incomplete import Incomplete as Incomplete
from collalign.products.pair import Alternative as Alternative
from collalign.products.pair import Pair as Pair
from collalign.products.posed_file import PosedFile as PosedFile
from collalign.products.run_record import Made as Made
from collalign.products.run_record import RunRecord as RunRecord
from collalign.products.shapes import Excluded as Excluded
from collalign.products.trust import Trust as Trust
from collalign.products.trust import Witness as Witness
from collalign.stages.poses.synchronize import pair_graph as pair_graph
from collalign.synchronization import synchronize as synchronize
from collalign.synchronization import synchronize_graph as synchronize_graph
from collalign.synchronization.problem.graph import PairGraph as PairGraph
from collalign.synchronization.result import SynchronizationResult as SynchronizationResult
from collalign.tools.certify.result import CertifiedCollection as CertifiedCollection
from collalign.tools.certify.result import JointBound as JointBound
from collalign.tools.certify.run import certify_collection as certify_collection
from collalign.tools.correspond.result import DenseCorrespondence as DenseCorrespondence
from collalign.tools.correspond.run import dense_correspondence as dense_correspondence
from collalign.tools.match.in_part import PartialMatch as PartialMatch
from collalign.tools.match.in_part import match_in_part as match_in_part
from collalign.tools.match.nonrigid import match_shapes as match_shapes
from collalign.tools.match.result import NonrigidCandidate as NonrigidCandidate
from collalign.tools.match.result import NonrigidMatch as NonrigidMatch
from collalign.tools.match.rigid import RigidMatch as RigidMatch
from collalign.tools.match.rigid import match_rigid as match_rigid
from collalign.tools.stability.result import Stability as Stability
from collalign.tools.stability.run import StabilityOptions as StabilityOptions
from collalign.tools.stability.run import check_stability as check_stability
from collalign.tools.transfer.result import TransferredLandmarks as TransferredLandmarks
from collalign.tools.transfer.run import transfer_landmarks as transfer_landmarks
from collalign.tools.variation.run import write_surface_variation as write_surface_variation
from collalign.tools.variation.surface_variation import SurfaceVariation as SurfaceVariation
from data_tools import errors as errors
from data_tools.embedding.embedding import Samples as Samples
from data_tools.io.listing import FolderListing as FolderListing
from data_tools.io.output_folder import OutputFolder as OutputFolder
from data_tools.io.source import Source as Source
from data_tools.landmarks.landmark_files import Landmarks as Landmarks
from data_tools.landmarks.landmark_files import SemilandmarkRows as SemilandmarkRows
from data_tools.landmarks.landmark_files import Semilandmarks as Semilandmarks
from data_tools.options import CleaningOptions as CleaningOptions
from data_tools.options import EmbeddingOptions as EmbeddingOptions
from data_tools.options import SamplingOptions as SamplingOptions
from data_tools.poses import Similarity as Similarity
from data_tools.surface.shape import Shape as Shape
from pairwise.certificates.certificate import Certificate as Certificate
from pairwise.dense.refine import RefinedPose as RefinedPose
from pairwise.options import MatchOptions as MatchOptions
from pairwise.options import PairOptions as PairOptions
from pairwise.partial.match import PartialPose as PartialPose
from pairwise.problem.pattern import RotationPattern as RotationPattern
from pairwise.results import Candidate as Candidate
from pairwise.results import MatchResult as MatchResult
from pairwise.status import Status as Status

__version__: str
__all__: list[str]
