"""A Dask cluster that may go away: every question to it has a time limit, and its loss is an error that says so."""

from __future__ import annotations

import asyncio
import logging
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from importlib.metadata import PackageNotFoundError, version
from queue import Empty, SimpleQueue
from typing import Any, TypeVar
from urllib.parse import urlsplit

from data_tools.errors import CollalignError, OptionsError, RunLost

try:
    from distributed import Client, Future, KilledWorker, WorkerPlugin
except ImportError as error:
    raise OptionsError(
        f"--scheduler needs Dask, which cannot be imported ({error}); install it with: pip install 'collalign[dask]'"
    ) from None

#: The one place that imports Dask hands on what a run needs of it.
__all__ = ["Cluster", "Future", "KilledWorker", "WorkerPlugin"]

Answer = TypeVar("Answer")

#: How schedulers are reached.
_PROTOCOLS = ("tcp", "tls", "ws", "wss", "ucx")
#: Until a scheduler answers at the address.
_CONNECT_TIMEOUT_S = 12.0
#: Until the first worker joins or a question is answered, and how fast at least what is sent with it goes out.
_ANSWER_TIMEOUT_S, _LEAST_BYTES_PER_S = 25.0, 5e7
#: Workers may all be gone for a while, as in a queue of jobs: until the run is given up.
_WORKERLESS_END_S = 600.0
#: Packages of which all machines need the same version for the same bytes.
_PACKAGES = ("collalign", "numpy", "scipy")


class Cluster:
    """A connection to a scheduler with at least one worker; see :meth:`connect`.

    Attributes
    ----------
    client : distributed.Client
        To be called through :meth:`ask` only.
    """

    def __init__(self, client: Client, address: str) -> None:
        self.client = client
        self._address = address
        self._seen_workers_s = time.monotonic()

    @classmethod
    @contextmanager
    def connect(cls, address: str) -> Iterator[Cluster]:
        """Connect to a scheduler, wait for a worker, and check that the workers have this program.

        Raises
        ------
        OptionsError
            If the address is none.
        RunLost
            If nobody answers, or no worker joins.
        CollalignError
            If the workers have other versions installed.
        """
        _check_address(address)
        with _silent_dask():
            try:
                client = _within(
                    _CONNECT_TIMEOUT_S,
                    Client,
                    address,
                    timeout=_CONNECT_TIMEOUT_S,
                    set_as_default=False,
                )
            except Exception as error:
                raise RunLost(
                    f"{address}: no Dask scheduler answers ({_one_line(error)})"
                ) from None
            try:
                cluster = cls(client, address)
                cluster._wait_for_workers()
                cluster._check_versions()
                yield cluster
            finally:
                with suppress(Exception):  # a scheduler that is gone needs no farewell
                    _within(_ANSWER_TIMEOUT_S / 5, client.close, timeout=_ANSWER_TIMEOUT_S / 6)

    def ask(
        self,
        question: Callable[..., Answer],
        *arguments: Any,
        num_bytes: float = 0.0,
        **options: Any,
    ) -> Answer:
        """Call a function of the client or of a future.

        Parameters
        ----------
        question : callable
        num_bytes : float
            Sent by it, to all workers together.

        Raises
        ------
        RunLost
            If there is no answer in time, or the connection is lost.
        Exception
            What the function raises.
        """
        if self.client.status != "running":
            raise self._lost()
        try:
            return _within(
                _ANSWER_TIMEOUT_S + num_bytes / _LEAST_BYTES_PER_S, question, *arguments, **options
            )
        except TimeoutError:
            raise self._lost() from None
        except Exception:
            if self.client.status != "running":
                raise self._lost() from None
            raise

    def num_cores(self) -> int:
        """Return the cores of all workers; 0 while there are none."""
        num = sum(self.ask(self.client.nthreads).values())
        if num:
            self._seen_workers_s = time.monotonic()
        return num

    def check(self) -> None:
        """Make sure that the scheduler is there; wait for workers, for a while.

        Raises
        ------
        RunLost
            If the scheduler is gone, or all workers have been for ten minutes.
        """
        if self.num_cores():
            return
        gone_s = time.monotonic() - self._seen_workers_s
        if gone_s > _WORKERLESS_END_S:
            raise RunLost(f"{self._address}: all workers are gone, for {gone_s:.0f} s now")

    def _wait_for_workers(self) -> None:
        while not self.num_cores():
            if time.monotonic() - self._seen_workers_s > _ANSWER_TIMEOUT_S:
                raise RunLost(
                    f"{self._address}: the scheduler has no workers; start some with 'dask worker {self._address}'"
                )
            time.sleep(0.2)

    def _check_versions(self) -> None:
        """Refuse a cluster whose present workers would compute something else."""
        here = _versions()
        try:
            everywhere = self.ask(
                self.client.run, _versions, on_error="ignore"
            )  # a worker may be dying
        except CollalignError:
            raise
        except Exception as error:
            raise CollalignError(
                f"the cluster's workers do not answer ({_one_line(error)})"
            ) from error
        for worker, there in everywhere.items():
            if there != here:
                names = ", ".join(_PACKAGES)
                raise CollalignError(
                    f"worker {worker}: has {names} {there}, here are {here}; install the same versions everywhere"
                )

    def _lost(self) -> RunLost:
        return RunLost(f"{self._address}: the Dask cluster does not answer any more")


def _within(
    seconds: float, function: Callable[..., Answer], *arguments: Any, **options: Any
) -> Answer:
    """Return what a function returns or raises, or raise TimeoutError; it goes on in a thread of its own then."""
    answers: SimpleQueue[tuple[Any, BaseException | None]] = SimpleQueue()

    def call() -> None:
        try:
            answers.put((function(*arguments, **options), None))
        except (
            asyncio.CancelledError
        ):  # no Exception, though Dask lets it out where a worker goes away
            answers.put((None, CancelledError()))
        except BaseException as error:
            answers.put((None, error))

    threading.Thread(target=call, daemon=True).start()
    try:
        answer, error = answers.get(timeout=seconds)
    except Empty:
        raise TimeoutError(f"no answer within {seconds:g} s") from None
    if error is not None:
        raise error
    return answer


def _check_address(address: str) -> None:
    """Refuse what is no address of a scheduler: Dask takes long over it."""
    try:
        parts = urlsplit(address)
        is_one = parts.scheme in _PROTOCOLS and bool(parts.hostname) and bool(parts.port)
    except ValueError:  # a port that there is not
        is_one = False
    if not is_one:
        raise OptionsError(f"scheduler: {address!r} is no address such as tcp://host:8786")


@contextmanager
def _silent_dask() -> Iterator[None]:
    """Keep Dask's own log of lost connections from the user: our errors say the same."""
    loggers = [logging.getLogger(name) for name in ("distributed", "tornado.application")]
    former = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for logger, level in zip(loggers, former, strict=True):
            logger.setLevel(level)


def _versions() -> tuple[str, ...]:
    return tuple(_version(package) for package in _PACKAGES)


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"


def _one_line(error: BaseException) -> str:
    return " ".join(f"{type(error).__name__}: {error}".split())[:300]
