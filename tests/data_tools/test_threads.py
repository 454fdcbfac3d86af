import sys
from types import FunctionType

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

import collalign
import collalign.output.report.page
import collalign.output.write
import collalign.synchronization
import collalign.tools.export.run
import pairwise
from collalign.engine.run_jobs import run_jobs
from data_tools import threads
from data_tools.arrays import as_points
from data_tools.embedding.embedding import sample_shape
from data_tools.threads import one_blas_thread

#: Beside whatever the packages export.
DOORS = {
    "save": collalign.output.write.save_collection,
    "export": collalign.tools.export.run.export,
    "report": collalign.output.report.page.write_report,
    "sample_shape": sample_shape,
}
PACKAGES = (collalign, collalign.synchronization, pairwise)


def num_threads(*ignored):
    return {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}


@pytest.fixture
def three_threads():
    """Let the caller have three threads, whatever the machine and its environment say."""
    with threadpool_limits(3, user_api="blas"):
        assert 3 in num_threads()
        yield


@pytest.mark.usefixtures("three_threads")
def test_inside_there_is_one_thread_and_the_caller_gets_his_back():
    before = num_threads()
    with one_blas_thread():
        assert num_threads() == {1}
        with one_blas_thread():
            assert num_threads() == {1}
        assert num_threads() == {1}
    assert num_threads() == before
    assert one_blas_thread()(num_threads)() == {1}
    with pytest.raises(ValueError, match="inside"), one_blas_thread():
        raise ValueError("inside")
    assert num_threads() == before


@pytest.mark.usefixtures("three_threads")
def test_a_library_that_comes_later_is_limited_by_the_next_door(monkeypatch):
    with one_blas_thread():
        threadpool_limits(2, user_api="blas")  # as a freshly loaded library would
        monkeypatch.setitem(sys.modules, "a_new_module", threads)
        with one_blas_thread():
            assert num_threads() == {1}


def is_door(function, monkeypatch):
    """Whether calling a function goes through the door before anything else."""

    class Entered(Exception):
        pass

    def entered():
        raise Entered

    with monkeypatch.context() as patched:
        patched.setattr(threads._LIMITER, "enter", entered)
        try:
            function()
        except Entered:
            return True
        except TypeError:  # missing arguments
            return False
    return False


#: Public functions that compute nothing.
NOT_COMPUTING = {"collalign.note_text"}


def public_functions():
    exported = {f"{p.__name__}.{name}": getattr(p, name) for p in PACKAGES for name in p.__all__}
    computing = {name: value for name, value in exported.items() if name not in NOT_COMPUTING}
    return DOORS | {
        name: value for name, value in computing.items() if isinstance(value, FunctionType)
    }


@pytest.mark.parametrize("name", public_functions())
def test_every_public_function_is_a_door(name, monkeypatch):
    assert is_door(public_functions()[name], monkeypatch)


def test_the_check_sees_a_function_without_a_door(monkeypatch):
    assert not is_door(as_points, monkeypatch)
    assert len(public_functions()) > 15


@pytest.mark.usefixtures("three_threads")
@pytest.mark.parametrize("num_jobs", [1, 2])
def test_tasks_have_one_thread(num_jobs):
    results = [
        result.value for result in run_jobs(num_threads, [("a", 0), ("b", 1)], num_jobs=num_jobs)
    ]
    assert results == [{1}, {1}]
