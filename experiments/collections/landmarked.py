"""The landmarked collections that most experiments share: the teeth and four classes of SHREC07."""

from __future__ import annotations

from pathlib import Path

from data_tools.datasets.public import Dataset, read_shrec07_class, read_teeth

#: Folders of the data that they lie in.
TEETH_FOLDER, CLASSES_FOLDER = "teeth_pnas116", "shrec07_dev"
CLASSES = ("glasses", "ant", "chair", "teddy")
#: A pose within this angle of the true one is right.
RIGHT_DEG = 20.0


def read_dataset(name: str, data: Path) -> Dataset:
    """Return the teeth (``"teeth"``), or a class of SHREC07 by its name."""
    return read_teeth(data / TEETH_FOLDER) if name == "teeth" else read_shrec07_class(data / CLASSES_FOLDER / name)
