"""What can be imported from ``collalign``: the package reads this list."""

from . import errors as errors
from . import landmarks as landmarks
from . import maps as maps
from . import options as options
from . import results as results
from . import statistics as statistics
from . import synchronization as synchronization
from .align import align_collection as align_collection
from .batch import run_batch as run_batch
from .engine.run_options import RunOptions as RunOptions
from .errors import CollalignError as CollalignError
from .extend import add_to_collection as add_to_collection
from .options import AlignOptions as AlignOptions
from .output.collection import Collection as Collection
from .output.loading import load as load
from .stages.poses.synchronize import pair_graph as pair_graph
from .synchronization.permutations import synchronize_permutations as synchronize_permutations
from .synchronization.solve import synchronize as synchronize
from .tools.certify.run import certify_collection as certify_collection
from .tools.match.in_part import match_in_part as match_in_part
from .tools.match.rigid import match_rigid as match_rigid
from .tools.stability.run import StabilityOptions as StabilityOptions
from .tools.stability.run import check_stability as check_stability
from .version import __version__ as __version__
from .wording import note_text as note_text

__all__: list[str]
