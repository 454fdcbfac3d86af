"""Reads hostile files, each in a process of its own with little memory and time: ``tests/fuzz/test_files.py``.

The processes are forked from one that has imported everything, so that a file takes milliseconds.
"""

import contextlib
import os
import re
import signal
import traceback

import psutil

from data_tools.errors import CollalignError

MEMORY_BYTES, TIME_S = 2 * 2**30, 30


def confined(target, payload, *, time_s=TIME_S):
    """Return how a target ends with a payload, (file name, content), in so many seconds and 2 GiB more."""
    reader, writer = os.pipe()
    child = os.fork()
    if not child:
        import resource  # which Windows has not

        os.close(reader)
        most = (
            psutil.Process().memory_info().vms + MEMORY_BYTES
        )  # beside what tests before have mapped
        resource.setrlimit(resource.RLIMIT_AS, (most, most))
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        signal.alarm(time_s)
        os.write(writer, _ending(target, payload).encode("utf-8", "backslashreplace")[:4000])
        os._exit(0)
    os.close(writer)
    with os.fdopen(reader, "rb") as stream:
        said = stream.read().decode()
    status = os.waitpid(child, 0)[1]
    if os.WIFSIGNALED(status):
        late = os.WTERMSIG(status) == signal.SIGALRM
        return f"undecided: {'no answer' if late else 'killed by signal'} {os.WTERMSIG(status)}"
    return said or "undecided: it said nothing"


def _ending(target, payload):
    with open(os.devnull, "w") as nowhere, contextlib.redirect_stdout(nowhere):
        try:
            target(payload)
        except CollalignError as error:
            internal = re.search(r"\w(Error|Exception)\b|Traceback", str(error))
            return f"names internals: {error}" if internal else "refused"
        except BaseException:
            return f"unclear error: {traceback.format_exc()[-1500:]}"
        return "valid"
