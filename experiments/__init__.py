"""The experiments: one command each, ``python -m experiments NAME``, over public collections.

They use the whole toolkit, so this sub-package alone in ``data_tools`` imports ``pairwise`` and ``collalign``.
"""

from __future__ import annotations

import importlib

from data_tools.errors import OptionsError
from experiments.experiment import Experiment

#: Experiments in the order of the page, each a module of this package with a constant ``EXPERIMENT``.
NAMES: tuple[str, ...] = (
    "figure3",
    "figure5",
    "scape",
    "tosca",
    "shrec07_maps",
    "faust",
    "theorem3",
    "figure13",
    "figure14",
    "classification",
    "collections",
    "invariants",
    "matching_table",
    "matching_energies",
    "partial_scans",
    "peers",
    "teeth_jobs",
    "deformations",
)


def load_experiment(name: str) -> Experiment:
    """Return an experiment by name.

    Raises
    ------
    OptionsError
        If there is none of this name.
    """
    if name not in NAMES:
        raise OptionsError(f"no experiment is called {name!r}; there are {', '.join(NAMES)}")
    experiment: Experiment = importlib.import_module(f"{__name__}.{name}").EXPERIMENT
    return experiment
