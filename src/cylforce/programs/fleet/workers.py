"""Workers: this process, local processes, or any cluster of Dask by the address of its scheduler."""

import logging
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import islice
from typing import Any, NamedTuple

from cylforce.files.atomic import RecordingError
from cylforce.programs.fleet.store import within
from cylforce.programs.fleet.task import on_worker

MEMORY = "800MB"  # of a local worker; beyond it Dask ends it, and a new one goes on
# What the C library keeps of freed memory [bytes], and from which size an array has pages of its own. Dask's 64 kB give
# every array back: nearly half of a worker's time went into taking it again (measured, see the chapter). One arena for
# all threads: in those of its own the thread of the tasks leaves gaps, and grew by half a megabyte with each recording.
ALLOCATOR = {"MALLOC_TRIM_THRESHOLD_": 2**26, "MALLOC_MMAP_THRESHOLD_": 2**25, "MALLOC_ARENA_MAX": 1}
# A worker keeps nothing that could be moved to disk, or become less by waiting: without this one at 80 % of its memory
# waits for ever. One at 95 % is ended, and its task tried again.
MEMORY_LIMITS = {"target": False, "spill": False, "pause": False, "terminate": 0.95}
# Dask's own profiler keeps the calls of each second for an hour: a megabyte of a worker's memory for each recording.
PROFILER = False
RETRIES = 2  # of a task whose worker ended, after which its recording is a row with that reason
CONNECT_S = 15.0  # in which a scheduler must answer
RESTART_S = 600.0  # in which a worker that ended must be there again; chosen: several ends one after the other
AHEAD = 8  # tasks given to each worker: so many results at most are lost when this program is killed
ENDED = "the scheduler ended, or the connection to it: what was done is kept; start it, and run again"
FEW = 2  # tasks, up to which no process is started for them

Take = Callable[[Any, Any], None]  # a job, and its result or exception
Say = Callable[[str], None]


class Where(NamedTuple):
    """Workers of a run.

    scheduler: address of a scheduler; None: local processes
    workers:   number of local processes; 0: only this one
    retries:   how often a task is tried again whose worker ended
    connect_s: time in which a scheduler must answer [s]
    ahead:     number of tasks given to each worker
    """

    scheduler: str | None = None
    workers: int = 2
    retries: int = RETRIES
    connect_s: float = CONNECT_S
    ahead: int = AHEAD


Jobs = Sequence[tuple[Any, ...]]


def computed(
    function: Callable[..., Any], jobs: Jobs, common: tuple[Any, ...], where: Where, take: Take, say: Say
) -> None:
    """Call `function(*job, *common)` for every job on the workers.

    `take` receives each job with its result as soon as it is there. Raises RecordingError when the scheduler does not
    answer, or ends.
    """
    if where.scheduler is None and (where.workers == 0 or len(jobs) <= FEW):
        for job in jobs:
            take(job, function(*job, *common))
        return
    from concurrent.futures import CancelledError

    from distributed.client import ClosedClientError
    from distributed.comm.core import CommClosedError

    with cluster_client(where, say) as client:
        try:
            _distributed(client, function, jobs, common, take, where.ahead)
        except (CancelledError, ClosedClientError, CommClosedError) as error:
            raise RecordingError(ENDED) from error


def _distributed(
    client: Any,  # noqa: ANN401 - Dask has no types
    function: Callable[..., Any],
    jobs: Jobs,
    common: tuple[Any, ...],
    take: Take,
    ahead: int,
) -> None:
    from distributed import as_completed
    from distributed.scheduler import KilledWorker

    # Results of tasks, not scattered: those lost with a worker that ends are computed again.
    shared = [client.submit(_same, each, pure=False) for each in common]
    waiting, job_of = iter(jobs), {}

    def submit(job: Any) -> Any:  # noqa: ANN401
        future = client.submit(function, *job, *shared, pure=False, retries=0)
        job_of[future.key] = job
        return future

    ended = []  # with their worker, which may have been another task's fault
    begun = ahead * max(len(client.scheduler_info()["workers"]), 1)
    running = as_completed([submit(job) for job in islice(waiting, begun)])
    for future in running:
        job, came = job_of.pop(future.key), _outcome(future)
        if isinstance(came, KilledWorker):
            ended.append(job)
        else:
            take(job, came)
        future.release()
        following = next(waiting, None)
        if following is not None:
            running.add(submit(following))
    for job in ended:
        take(job, _outcome(submit(job)))


def _same(value: Any) -> Any:  # noqa: ANN401
    return value


def _outcome(future: Any) -> Any:  # noqa: ANN401 - Dask has no types
    """Return the result of a task, or its exception. Raises CancelledError when the scheduler is lost."""
    from concurrent.futures import CancelledError

    try:
        return future.result()
    except CancelledError:
        raise
    except Exception as error:  # noqa: BLE001 - whatever ended one task must not end the others
        return error


@contextmanager
def cluster_client(where: Where, say: Say) -> Iterator[Any]:
    """Connect to a Dask scheduler, or start workers on this computer, and end them at the end of the block.

    where: address of the scheduler, or number of workers here
    say:   is called with a sentence about the workers
    """
    import dask
    from distributed import Client, LocalCluster

    settings: dict[str, Any] = {
        "distributed.nanny.pre-spawn-environ": dask.config.get("distributed.nanny.pre-spawn-environ") | ALLOCATOR,
        **{f"distributed.worker.memory.{name}": value for name, value in MEMORY_LIMITS.items()},
        "distributed.worker.profile.enabled": PROFILER,
        "distributed.scheduler.allowed-failures": where.retries,
        "distributed.comm.timeouts.connect": f"{where.connect_s:g}s",
        "distributed.deploy.lost-worker-timeout": f"{RESTART_S:g}s",
    }
    with dask.config.set(settings):
        if where.scheduler is not None:
            cure = f"--scheduler {where.scheduler}: cannot be reached (start it, or check the address)"
            client = within(where.connect_s + 5.0, lambda: Client(where.scheduler, timeout=where.connect_s), cure)
            with client:
                check_version(client)
                say(f"scheduler {where.scheduler}, {len(client.nthreads())} workers; dashboard {client.dashboard_link}")
                yield client
            return
        local: dict[str, Any] = {"host": "127.0.0.1", "dashboard_address": "127.0.0.1:0", "memory_limit": MEMORY}
        local |= {"n_workers": where.workers, "threads_per_worker": 1, "silence_logs": logging.CRITICAL}
        with LocalCluster(**local) as cluster, Client(cluster) as client:
            say(f"{where.workers} workers of at most {MEMORY}; dashboard {client.dashboard_link}")
            yield client


def check_version(client: Any) -> None:  # noqa: ANN401 - Dask has no types
    """Check that all workers have the caller's program: results must not depend on the worker. Raises
    RecordingError.
    """
    programs = {name: said[0] for name, said in client.run(on_worker).items()}
    if not programs:
        raise RecordingError("the scheduler has no worker: start one (dask worker ADDRESS)")
    other = [name for name, said in programs.items() if said != on_worker()[0]]
    if other:
        raise RecordingError(f"worker {other[0]} has another version of cylforce or of its libraries: install the same")
