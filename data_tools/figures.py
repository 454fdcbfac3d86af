"""Matplotlib figures that notebooks show by themselves."""

from __future__ import annotations

from functools import cache
from io import BytesIO
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def new_figure(**options: Any) -> Figure:
    """Return a figure without pyplot, which keeps no list of it; a cell of a notebook that ends with it shows it.

    Parameters
    ----------
    **options
        As :class:`matplotlib.figure.Figure` takes them.
    """
    return _figure_class()(**options)


@cache
def _figure_class() -> Any:
    from matplotlib.figure import Figure

    class SelfShowingFigure(Figure):
        """A figure that IPython can draw before anybody has imported pyplot."""

        def _repr_png_(self) -> bytes:
            buffer = BytesIO()
            self.savefig(buffer, format="png")
            return buffer.getvalue()

    return SelfShowingFigure
