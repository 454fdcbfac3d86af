import pytest

from tests.export_readers import read_morphologika

GOOD = "[individuals]\n1\n[landmarks]\n2\n[dimensions]\n3\n[names]\nA\n[rawpoints]\n'A\n0 0 0\n1 0 NaN\n"


def test_morphologika_reader_reads_the_format(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text(GOOD)
    found = read_morphologika(path)
    assert found.names == ("A",)
    assert found.points.shape == (1, 2, 3)


@pytest.mark.parametrize(
    "bad",
    [
        GOOD.replace("'A\n", ""),
        GOOD.replace("\n1 0 NaN", ""),
        GOOD.replace("A\n[raw", "names_1\n[raw"),
        GOOD.replace("[dimensions]\n3\n", ""),
    ],
)
def test_morphologika_reader_refuses_what_geomorph_would_misread(tmp_path, bad):
    path = tmp_path / "a.txt"
    path.write_text(bad)
    with pytest.raises(ValueError, match=r"section|specimen"):
        read_morphologika(path)
