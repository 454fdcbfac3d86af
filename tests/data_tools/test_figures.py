from io import BytesIO

from matplotlib.figure import Figure
from matplotlib.image import imread

from data_tools.html_pages import new_figure


def test_a_figure_shows_itself_as_a_picture():
    figure = new_figure(figsize=(3.0, 2.0), dpi=50)
    assert isinstance(figure, Figure)
    assert imread(BytesIO(figure._repr_png_())).shape[:2] == (100, 150)
