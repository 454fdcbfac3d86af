"""Landmarks of a few specimens on all others: what reads them, carries them, and holds what was carried."""

from collalign.template_landmarks.templates import SemilandmarkRequest
from collalign.tools.transfer.result import TransferredLandmarks
from collalign.tools.transfer.run import transfer_landmarks
from data_tools.landmark_files import (
    Landmarks,
    SemilandmarkRows,
    Semilandmarks,
    read_landmarks,
    read_semilandmarks,
)

__all__ = [
    "Landmarks",
    "SemilandmarkRequest",
    "SemilandmarkRows",
    "Semilandmarks",
    "TransferredLandmarks",
    "read_landmarks",
    "read_semilandmarks",
    "transfer_landmarks",
]
