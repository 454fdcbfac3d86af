"""The report: one self-contained HTML file in which a person sees a result, trusts it or corrects it."""

from collalign.output.evidence.display_mesh import display_mesh, faces_per_shape
from collalign.output.report.page import render_report, write_report

__all__ = ["display_mesh", "faces_per_shape", "render_report", "write_report"]
