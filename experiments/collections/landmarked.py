"""The collections that experiments share, with their ground truth."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

from data_tools.surface.shape import Shape
from experiments.datasets import (
    Dataset,
    read_canonical_class,
    read_landmark_archive,
    read_landmarked_folder,
    read_registered_archive,
    read_registered_folder,
    read_shrec07_class,
    read_teeth,
)
from experiments.peers.bones import landmarked_bones

#: Folders of the data that they lie in.
TEETH_FOLDER, CLASSES_FOLDER, OBJECTS_FOLDER = "teeth_pnas116", "shrec07_dev", "capod7"
CLASSES = ("glasses", "ant", "chair", "teddy")
#: Classes whose members bend, or were added later.
MORE_CLASSES = ("human", "fish", "armadillo", "plane", "bird")
#: Classes of objects with canonical poses; vases are not among them, which look the same after any rotation.
OBJECTS = ("guitar", "spider", "dolphin", "gun", "horse", "piano")
#: Long bones that are generated, each with 16 landmarks.
NUM_BONES = 20
#: A pose within this angle of the true one is right.
RIGHT_DEG = 20.0


def _read_object(name: str, data: Path) -> Dataset:
    return read_canonical_class(data / OBJECTS_FOLDER / name)


def _long_bones(_: Path) -> Dataset:
    shapes, landmarks = landmarked_bones(NUM_BONES)
    loaders = tuple(partial(_itself, shape) for shape in shapes)
    return Dataset(
        names=tuple(shape.name for shape in shapes), loaders=loaders, landmarks=landmarks
    )


def _itself(shape: Shape) -> Shape:
    return shape


#: Readers of the collections that are no class of SHREC07.
_READERS: dict[str, Callable[[Path], Dataset]] = {
    "teeth": lambda data: read_teeth(data / TEETH_FOLDER),
    "mouse skulls": lambda data: read_landmarked_folder(data / "mouse_skulls62"),
    "mouse landmarks": lambda data: read_landmark_archive(
        data / "mouse_skull_landmarks126" / "mouse_landmarks.npz"
    ),
    "scape": lambda data: read_registered_archive(data / "scape71"),
    "centaur": lambda data: read_registered_folder(data / "tosca_centaur6"),
    **{name: partial(_read_object, name) for name in OBJECTS},
}
#: Those that are generated.
_GENERATED = {"long bones": _long_bones}
#: Every real collection whose true rotations are known.
COLLECTIONS = (*_READERS, *CLASSES, *MORE_CLASSES)


def read_dataset(name: str, data: Path) -> Dataset:
    """Return a collection of :data:`COLLECTIONS`, or a generated one."""
    reader = (_READERS | _GENERATED).get(name)
    return reader(data) if reader else read_shrec07_class(data / CLASSES_FOLDER / name)
