"""Workers on a dask.distributed cluster: this machine's, or any scheduler that is already running.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from typing import Any

from pilotgen.errors import FileError
from pilotgen.runs.executor import SINGLE_THREAD_VARIABLES, WorkerLost, is_stopped
from pilotgen.runs.memory import peak_with_children_bytes

CONNECT_TIMEOUT_S = 20.0
LOOPBACK = "127.0.0.1"
TLS_SETTINGS = ("CA_FILE", "CLIENT__CERT", "CLIENT__KEY")
_LOOK_EVERY_S = 1.0
IN_FLIGHT_PER_WORKER = 4  # hides the scheduler's latency; more would only cost memory


class DaskWorkers:
    """Runs tasks on dask workers; a task whose worker dies is given to another by the scheduler.

    Parameters
    ----------
    address : str, optional
        Address of a running scheduler. Without one, a cluster of processes is started on this machine.
    count : int
        Number of processes of that local cluster.
    time_limit_s : float
        A worker of that local cluster that is stopped for so long is killed; the scheduler has a new one do its tasks.

    Raises
    ------
    FileError
        The package is missing, nobody answers at the address, or certificates are missing or refused.
    """

    def __init__(self, address: str | None, count: int, time_limit_s: float = 30.0) -> None:
        try:
            import dask
            from distributed import Client, LocalCluster
        except ImportError:
            raise FileError(
                "--executor dask needs the package distributed; install it with: pip install 'pilotgen[cluster]'"
            ) from None
        # A worker killed from outside is no fault of the pilots it had; only repeated deaths are.
        dask.config.set({"distributed.scheduler.allowed-failures": 5, "distributed.admin.log-length": 100})
        self._cluster = None
        self._largest_bytes = 0
        if address is None:
            environment = dict.fromkeys(SINGLE_THREAD_VARIABLES, "1")
            dask.config.set({"distributed.nanny.pre-spawn-environ": environment})
            dask.config.set({"distributed.scheduler.http.routes": [], "distributed.worker.http.routes": []})
            # Who reaches a scheduler runs programs as its user: nobody but this machine does, and there are no pages.
            self._cluster = LocalCluster(
                n_workers=count,
                threads_per_worker=1,
                processes=True,
                host=LOOPBACK,
                dashboard_address=None,
                scheduler_kwargs={"dashboard": False, "dashboard_address": f"{LOOPBACK}:0"},
            )
            self._over = threading.Event()
            threading.Thread(target=self._end_stopped_workers, args=(time_limit_s,), daemon=True).start()
        try:
            self._client = Client(
                self._cluster if self._cluster is not None else address, timeout=CONNECT_TIMEOUT_S, set_as_default=False
            )
        except (OSError, ValueError, TypeError, TimeoutError, RuntimeError) as error:
            self._stop_cluster()
            if str(address).startswith("tls:"):
                names = ", ".join(f"DASK_DISTRIBUTED__COMM__TLS__{name}" for name in TLS_SETTINGS)
                raise FileError(
                    f"--scheduler {address}: no dask scheduler answers there, or not to these certificates ({error}); "
                    f"they are named by the environment variables {names} (docs/cluster.md)"
                ) from None
            raise FileError(
                f"--scheduler {address}: no dask scheduler answers there ({error}); start one with: dask scheduler"
            ) from None

    def warm_up(self, function: Callable[[Any], Any], task: Any) -> None:
        """Nothing: a cluster's workers have been at it for a while, or come later."""

    def run(self, function: Callable[[Any], Any], tasks: Sequence[Any]) -> Iterator[tuple[int, Any]]:
        """Yield (index, result) as they finish; a task that keeps killing its workers yields a WorkerLost."""
        from distributed import KilledWorker, as_completed

        numbers: dict[Any, int] = {}
        completed = as_completed(loop=self._client.loop)
        following = iter(enumerate(tasks))

        def submit(count: int) -> None:
            for _ in range(count):
                item = next(following, None)
                if item is None:
                    return
                future = self._client.submit(_weighed, function, item[1], pure=False)
                numbers[future.key] = item[0]
                completed.add(future)

        submit(self._in_flight())
        try:
            for future in completed:
                try:
                    result, bytes_had = future.result()
                    self._largest_bytes = max(self._largest_bytes, int(bytes_had))
                except KilledWorker as error:
                    reason = f"dask gave the pilot up after several workers died with it ({error.last_worker})"
                    result = WorkerLost(reason)
                yield numbers.pop(future.key), result
                future.release()
                submit(max(1, self._in_flight() - len(numbers)))  # workers come and go
        finally:
            if numbers:
                self._client.cancel(list(numbers), force=True)

    def _in_flight(self) -> int:
        workers = self._client.scheduler_info(n_workers=-1)["workers"].values()
        threads = sum(int(worker["nthreads"]) for worker in workers)
        return IN_FLIGHT_PER_WORKER * max(1, threads)

    def memory_bytes(self) -> int:
        """Largest memory that one worker and its solver had so far, as workers tell it with their answers."""
        return self._largest_bytes

    def close(self) -> None:
        """Leave the cluster; stop it if it is ours."""
        self._client.close()
        self._stop_cluster()

    def _stop_cluster(self) -> None:
        if self._cluster is not None:
            self._over.set()
            self._cluster.close()

    def _end_stopped_workers(self, limit_s: float) -> None:
        """Watch the local cluster's processes until it is over."""
        stopped_s: dict[int, float] = {}
        last = time.monotonic()
        while not self._over.wait(min(_LOOK_EVERY_S, 0.5 * limit_s)):
            now = time.monotonic()
            passed, last = min(now - last, 2.0 * _LOOK_EVERY_S), now  # not what we were stopped ourselves
            nannies = list(getattr(self._cluster, "workers", {}).values())
            pids = [getattr(getattr(nanny, "process", None), "pid", None) for nanny in nannies]
            stopped_s = {pid: stopped_s.get(pid, 0.0) + passed for pid in pids if pid is not None and is_stopped(pid)}
            for pid, seconds in stopped_s.items():
                if seconds > limit_s:
                    with suppress(OSError):
                        os.kill(pid, signal.SIGKILL)


def _weighed(function: Callable[[Any], Any], task: Any) -> tuple[Any, int]:
    """What a worker answers, and the largest memory that it and its solver had so far: it may be on another machine."""
    return function(task), peak_with_children_bytes(os.getpid())
