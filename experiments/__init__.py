"""The experiments: one command each, ``python -m experiments NAME``, over public collections.

They use the whole toolkit and are not part of the installed packages.
"""

from __future__ import annotations

import importlib

from data_tools.errors import OptionsError
from experiments.experiment import Experiment

#: Experiments in the order of the page, and the folder of the module that holds the constant ``EXPERIMENT`` of each.
_FOLDERS = {
    "figure3": "figures",
    "figure5": "figures",
    "maps": "maps",
    "bodies": "maps",
    "cuts": "maps",
    "consistent_maps": "maps",
    "theorem3": "figures",
    "figure13": "figures",
    "figure14": "figures",
    "classification": "collections",
    "bending": "collections",
    "proofs": "pairs",
    "capod": "peers",
    "scans": "peers",
    "landmarks": "peers",
    "radii": "collections",
    "templates": "collections",
    "synchronization": "peers",
    "teeth_jobs": "collections",
    "deformations": "collections",
    "confidence": "confidence",
    "ablation": "collections",
    "scoreboard": "collections",
    "kinds": "collections",
    "library": "collections",
    "parts": "collections",
    "speed": "peers",
}
NAMES: tuple[str, ...] = tuple(_FOLDERS)


def load_experiment(name: str) -> Experiment:
    """Return an experiment by name.

    Raises
    ------
    OptionsError
        If there is none of this name.
    """
    if name not in NAMES:
        raise OptionsError(f"no experiment is called {name!r}; there are {', '.join(NAMES)}")
    experiment: Experiment = importlib.import_module(
        f"{__name__}.{_FOLDERS[name]}.{name}"
    ).EXPERIMENT
    return experiment
