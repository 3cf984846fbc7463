"""Workers on a dask.distributed cluster: this machine's, or any scheduler that is already running.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

from pilotgen.errors import FileError
from pilotgen.runs.executor import SINGLE_THREAD_VARIABLES, WorkerLost

CONNECT_TIMEOUT_S = 20.0
IN_FLIGHT_PER_WORKER = 4  # hides the scheduler's latency; more would only cost memory


class DaskWorkers:
    """Runs tasks on dask workers; a task whose worker dies is given to another by the scheduler.

    Parameters
    ----------
    address : str, optional
        Address of a running scheduler. Without one, a cluster of processes is started on this machine.
    count : int
        Number of processes of that local cluster.
    """

    def __init__(self, address: str | None, count: int) -> None:
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
        if address is None:
            environment = dict.fromkeys(SINGLE_THREAD_VARIABLES, "1")
            dask.config.set({"distributed.nanny.pre-spawn-environ": environment})
            self._cluster = LocalCluster(n_workers=count, threads_per_worker=1, processes=True, dashboard_address=None)
        try:
            self._client = Client(
                self._cluster if self._cluster is not None else address, timeout=CONNECT_TIMEOUT_S, set_as_default=False
            )
        except (OSError, ValueError, TimeoutError) as error:
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
                future = self._client.submit(function, item[1], pure=False)
                numbers[future.key] = item[0]
                completed.add(future)

        submit(self._in_flight())
        try:
            for future in completed:
                try:
                    result = future.result()
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

    def close(self) -> None:
        """Leave the cluster; stop it if it is ours."""
        self._client.close()
        if self._cluster is not None:
            self._cluster.close()
