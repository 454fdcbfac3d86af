"""How work gets done: stages, jobs and the store. It knows nothing of shapes.

* ``session``: what the stages of a run share; one ``compute``
* ``run_options``: workers and limits
* ``progress``: bars with the remaining time, and lines
* ``command_line``: the command that runs, signals that end it, JSON types
* ``job``: what a stage hands in
* ``run_jobs``, ``local_jobs``, ``dask_jobs``: runs jobs, on one machine or several; both find the task that kills its
  worker
* ``local_pool``, ``dask_cluster``: joblib's workers; Dask's
* ``worker``: guards a task
* ``store``, ``store_file``: keys and entries; SQLite
* ``records``: dataclasses as records, checked

Work for the workers is a ``Job(kind, version, run, reader)`` next to its function ``run``. That takes plain arguments
and returns a frozen dataclass whose annotations say what its fields hold (``Holds``). ``session.compute`` keeps,
checks and returns its results; ``job.shared(key)`` as an argument stands for the result of another job. Raise
``version`` whenever the same input gives another result.
"""
