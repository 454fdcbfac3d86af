"""What is done to a damaged file: each ends in a value, or in an error that the project raises on purpose."""

import contextlib
import io
import re
import tempfile
from pathlib import Path

from collalign.cli import main
from collalign.engine.records import decode, from_record
from collalign.engine.store import Store
from collalign.stages.match_pairs import PairPoses
from data_tools.embedding.embedding import Samples, sample_shape
from data_tools.errors import InputError
from data_tools.io.listing import READERS
from data_tools.io.shapes import read_shape
from data_tools.landmark_tables import read_specimens
from data_tools.options import SamplingOptions
from pairwise import verify_certificate
from pairwise.certificates.certificate import Certificate
from tests.fuzz import seeds
from tests.fuzz.damage import MARK

SAMPLING = SamplingOptions(num_points=8, num_dense_points=10)


def kinds(folder):
    """Return the target of every kind of file and its good files by name, made in a folder; readers by suffix."""
    (folder / "shapes").mkdir()
    shapes = seeds.shape_files(folder / "shapes")
    return {
        "shapes": (read_and_sample, shapes),
        **{
            end: (read_and_sample, {n: data for n, data in shapes.items() if n.endswith(end)})
            for end in READERS
        },
        "landmarks": (read_landmark_file, seeds.landmark_files()),
        "stores": (read_store, {"a.store": seeds.store_file(folder)}),
        "records": (read_record, seeds.records()),
        "certificate-files": (read_certificate, {"a.npz": seeds.certificate_file(folder)}),
        "configs": (read_config, {"a.toml": seeds.CONFIG.encode()}),
    }


def read_and_sample(payload, read=read_shape):
    """Read a shape file and prepare it for matching; returns the number of vertices. No reason quotes the file."""
    with _as_file(payload) as path:
        try:
            shape = read(path)
        except InputError as error:
            reason = str(error).removeprefix(str(path))
            if MARK in reason or re.search(r"\w(Error|Exception)\b", reason):
                raise RuntimeError(f"quotes the file or names internals: {reason}") from error
            raise
        sample_shape(shape, SAMPLING)
        return len(shape.vertices)


def read_shape_file(payload):
    """Read a shape file; returns the number of vertices."""
    with _as_file(payload) as path:
        return len(read_shape(path).vertices)


def read_landmark_file(payload):
    """Read a landmark file of one or several specimens; returns how many landmarks it holds."""
    with _as_file(payload) as path:
        return sum(len(marks.points) for marks in read_specimens(path).values())


def read_store(payload):
    """Open a store, read all that is in it, and open it for writing; returns the number of records."""
    with _as_file(payload) as path:
        with Store.open(path, read_only=True) as store:
            store.status()
            for kind, reader in (("shapes", Samples), ("pairs", PairPoses)):
                store.failures(kind)
                store.median_seconds(kind)
                for key in sorted(store.keys(kind)):
                    from_record(reader, store.require(kind, key), key)
        with Store.open(path) as store:
            store.put("pairs", "new", {"x": 1})
            return len(store.keys("pairs"))


def read_record(payload):
    """Decode a record whose digest would fit, as a forger could arrange, and check its fields."""
    name, data = payload
    from_record(Samples if name == "shape.record" else PairPoses, decode(data, name), name)
    return len(data)


def read_certificate(payload):
    """Load a certificate and verify it; returns the bound."""
    with _as_file(payload) as path:
        return verify_certificate(*seeds.certificate_problem(), Certificate.load(path))


def read_config(payload):
    """Run the command line with a configuration file on a folder that holds no shapes; returns the exit code."""
    with _as_file(payload) as path, contextlib.redirect_stderr(io.StringIO()) as text:
        shapes = path.parent / "shapes"
        shapes.mkdir()
        with contextlib.redirect_stdout(text):
            code = main(
                ["--config", str(path), "align", str(shapes), "--out", str(path.parent / "out")]
            )
        if code == 2:
            raise InputError(text.getvalue()[-300:])
        return code


@contextlib.contextmanager
def _as_file(payload):
    name, data = payload
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        path.write_bytes(data)
        yield path
