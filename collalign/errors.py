"""Every error of the toolkit. All are :class:`CollalignError`, and each has the exit code of a command.

>>> try:
...     collalign.align_collection("bnes")
... except collalign.errors.InputError as error:
...     print(error)
bnes: no such folder
"""

from data_tools.errors import (
    CollalignError,
    CollectionError,
    InputError,
    OptionsError,
    RunLost,
    SolveFailed,
    StoreError,
    UnavailableError,
    UnknownName,
)

__all__ = [
    "CollalignError",
    "CollectionError",
    "InputError",
    "OptionsError",
    "RunLost",
    "SolveFailed",
    "StoreError",
    "UnavailableError",
    "UnknownName",
]
