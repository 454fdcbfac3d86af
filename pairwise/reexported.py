"""Types and errors of the package below that can be imported from ``pairwise`` as well."""

from data_tools.errors import InputError as InputError
from data_tools.errors import OptionsError as OptionsError
from data_tools.errors import SolveFailed as SolveFailed
from data_tools.local_surface import LocalSurface as LocalSurface
