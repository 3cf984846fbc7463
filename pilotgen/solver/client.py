"""Find, start, ask and restart the solver `mbdae`.

Protocol: docs/io_formats/serve.md. One `SolverClient` keeps one `mbdae --serve` alive between pilots. When that process
dies, hangs or answers nonsense, the request at hand fails with a SolverError that says so, and the next one gets a new
process.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import os
import select
import shutil
import signal
import subprocess
import tempfile
import time
import weakref
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import IO, Any

import orjson

from pilotgen.errors import FileError, SolverError
from pilotgen.solver.program import packaged_mbdae
from pilotgen.solver.protocol import ProtocolError, SolverReply, excerpt, read_reply

DEFAULT_TIMEOUT_S = 30.0
"""Time limit of one request [s]; a pilot's deck takes some milliseconds."""

_LONGEST_REPLY_BYTES = 256 << 20


# ---- finding -----------------------------------------------------------------------------------------------------


def find_mbdae(option: str | os.PathLike[str] | None = None) -> Path:
    """Return the path of the solver's executable.

    FileError if there is none, or what was named is no program.

    Looked for in this order: `option`, the environment variable PILOTGEN_MBDAE, the installed package, PATH. Something
    named by the first two must be there: it is an error, not a reason to look on.
    """
    named = named_executable(option, "--mbdae", "PILOTGEN_MBDAE")
    if named is not None:
        return named
    packaged = packaged_mbdae()
    if packaged is not None:
        return packaged
    on_path = shutil.which("mbdae")
    if on_path is not None:
        return Path(on_path)
    raise FileError(
        "the solver 'mbdae' is not installed: not in the pilotgen package, not on PATH, and PILOTGEN_MBDAE is not set. "
        "Build it with 'make install' in the source tree (or 'pip install .'), "
        "or set PILOTGEN_MBDAE to the path of an mbdae executable"
    )


def named_executable(option: str | os.PathLike[str] | None, flag: str, variable: str) -> Path | None:
    """A program that an option or else an environment variable names; FileError if it is not there."""
    source, given = (flag, option) if option else (variable, os.environ.get(variable))
    if not given:
        return None
    path = Path(given)
    if not path.exists():
        raise FileError(f"{source}: '{path}' does not exist; the path of a solver executable was expected")
    if not path.is_file() or not os.access(path, os.X_OK):
        raise FileError(f"{source}: '{path}' is not an executable file; the path of a solver executable was expected")
    return path.absolute()  # a bare name would be looked for on PATH, not here


# ---- mbdae -------------------------------------------------------------------------------------------------------


class SolverClient:
    """A long-lived `mbdae --serve`, started at the first request.

    Use as a context manager, or call `close`. The process also ends when this object is collected, when Python exits
    and when Python dies. A client that crossed a fork starts a process of its own in the child.

    Parameters
    ----------
    executable : path of `mbdae`; None = `find_mbdae`
    timeout_s : time limit of one request unless the request says otherwise [s]
    directory : where the solver works, which relative names in requests belong to; None = where this process works
    """

    def __init__(
        self,
        executable: str | os.PathLike[str] | None = None,
        timeout_s: float = DEFAULT_TIMEOUT_S,
        directory: str | os.PathLike[str] | None = None,
    ) -> None:
        self.executable = find_mbdae(executable)
        self.timeout_s = timeout_s
        self.directory = directory
        self._running: _Running | None = None
        self._next_id = 1

    def __enter__(self) -> SolverClient:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the solver process, if any. The client can be used again: the next request starts another one."""
        if self._running is not None:
            self._running.end()
            self._running = None

    @property
    def pid(self) -> int | None:
        """Process id of the solver at work, None when there is none."""
        return self._running.process.pid if self._running is not None else None

    def request(
        self,
        task: str,
        *,
        deck_text: str | None = None,
        name: str | os.PathLike[str] = "deck.mbd",
        output: str | os.PathLike[str] | None = None,
        timeout_s: float | None = None,
        check: bool = True,
        **options: Any,
    ) -> SolverReply:
        """Have `task` done on one deck and return the reply.

        Parameters
        ----------
        task : "check", "static", "linearise", "integrate", "residuals" or "version"
        deck_text : the deck; None = read the file `name`
        name : the deck's path, or with `deck_text` what messages call it
        output : file to write; None = write nothing
        timeout_s : time limit [s]; None = the client's
        check : raise SolverError when the status is not "ok"; otherwise return that reply
        options : as the solver's command line options, e.g. `c=0.005`, `rtol=1e-9`

        Raises
        ------
        SolverError
            stage "solver": the solver refused the deck, did not converge, died, took too long or made a protocol error.
        """
        running = self._alive()
        request_id = self._next_id
        self._next_id += 1
        request: dict[str, Any] = {"id": request_id, "task": task, "deck": os.fspath(name)}
        if deck_text is not None:
            request["text"] = deck_text
        if output is not None:
            request["output"] = os.fspath(output)
        if options:
            request["options"] = options
        line = orjson.dumps(request) + b"\n"
        limit_s = self.timeout_s if timeout_s is None else timeout_s
        try:
            answer = running.exchange(line, limit_s)
            reply = read_reply(answer, request_id)
        except ProtocolError as error:
            self.close()
            raise SolverError("solver", f"protocol error of mbdae on {os.fspath(name)}: {error}") from None
        except _Lost as lost:
            reason = self._describe_end(running, lost, os.fspath(name), limit_s)
            raise SolverError("solver", reason, died=not lost.timed_out) from None
        except BaseException:
            # Interrupted between request and reply: whatever comes next would answer the wrong question.
            self.close()
            raise
        if check and reply.status != "ok":
            raise SolverError("solver", reply.message or f"mbdae answered '{reply.status}' on {os.fspath(name)}")
        return reply

    def version(self) -> str:
        """Name and version of the solver, e.g. "mbdae 1.0.0"."""
        return self.request("version").message

    def _alive(self) -> _Running:
        running = self._running
        if running is not None and running.owner_pid != os.getpid():
            running.forget()  # the parent's process, not ours
            running = None
        if running is not None and running.process.poll() is not None:
            running.end()
            running = None
        if running is None:
            running = _Running(self.executable, self.directory)
        self._running = running
        return running

    def _describe_end(self, running: _Running, lost: _Lost, name: str, limit_s: float) -> str:
        """End a process that failed and say in one sentence what it did."""
        self._running = None
        if lost.timed_out:
            running.end()
            return f"mbdae did not answer on {name} within {limit_s:g} s and was stopped"
        code = running.wait_for_end()
        lines = running.last_stderr_lines()
        running.end()
        if code is not None and code < 0:
            how = f"died with signal {signal_name(-code)}"
        else:
            how = f"ended with exit code {code}" if code is not None else "closed its output"
        return f"mbdae {how} on {name}" + (f"; its last stderr lines: {lines}" if lines else "")


class _Lost(Exception):
    """The exchange failed: it took too long, or the process ended."""

    def __init__(self, timed_out: bool = False) -> None:
        super().__init__()
        self.timed_out = timed_out


class _Running:
    """One solver process and its pipes."""

    def __init__(self, executable: Path, directory: str | os.PathLike[str] | None) -> None:
        self.owner_pid = os.getpid()
        self._stderr: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115 - lives as long as the process
        command = [str(executable), "--serve", "--exit-with-parent", str(self.owner_pid)]
        try:
            self.process = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._stderr,
                bufsize=0,
                cwd=directory,
            )
        except OSError as error:
            self._stderr.close()
            raise FileError(f"cannot start the solver '{executable}': {error.strerror}") from error
        assert self.process.stdin is not None and self.process.stdout is not None
        self._in, self._out = self.process.stdin.fileno(), self.process.stdout.fileno()
        os.set_blocking(self._in, False)
        os.set_blocking(self._out, False)
        self._poll = select.poll()
        self._poll.register(self._out, select.POLLIN)
        self._finalizer = weakref.finalize(self, _end_process, self.process, self.owner_pid)

    def exchange(self, line: bytes, limit_s: float) -> bytes:
        """Send one line, receive one line; never longer than `limit_s`."""
        deadline = time.monotonic() + limit_s
        to_send = self._send(memoryview(line))  # most fit into the pipe at once
        if to_send:
            self._poll.register(self._in, select.POLLOUT)
        received: list[bytes] = []
        size = 0
        while True:
            remaining = deadline - time.monotonic()
            if remaining <= 0.0:
                raise _Lost(timed_out=True)
            for fd, _event in self._poll.poll(1000.0 * remaining):
                if fd == self._in:
                    to_send = self._send(to_send)
                    if not to_send:
                        self._poll.unregister(self._in)
                else:
                    try:
                        chunk = os.read(self._out, 1 << 20)
                    except BlockingIOError:
                        continue
                    if not chunk:
                        raise _Lost
                    received.append(chunk)
                    size += len(chunk)
                    if b"\n" in chunk:
                        return self._one_line(b"".join(received), sent_all=not to_send)
                    if size > _LONGEST_REPLY_BYTES:
                        raise ProtocolError("a reply without end")

    def _send(self, data: memoryview) -> memoryview:
        """What the pipe does not take yet."""
        try:
            return data[os.write(self._in, data[:65536]) :]
        except BlockingIOError:
            return data
        except OSError:  # nobody reads any more; what is left to read tells why
            return data[:0]

    @staticmethod
    def _one_line(received: bytes, sent_all: bool) -> bytes:
        line, _, rest = received.partition(b"\n")
        if rest:
            raise ProtocolError(f"more than one line in reply to one request: {excerpt(rest)}")
        if not sent_all:
            raise ProtocolError(f"a reply before the request was complete: {excerpt(line)}")
        return line

    def wait_for_end(self) -> int | None:
        """Exit code (negative: signal) of a process that closed its output; None if it lives on."""
        try:
            return self.process.wait(timeout=2.0)
        except subprocess.TimeoutExpired:
            return None

    def last_stderr_lines(self) -> str:
        """The last line on standard error, shortened."""
        self._stderr.seek(0, os.SEEK_END)
        self._stderr.seek(max(0, self._stderr.tell() - 4096))
        lines = self._stderr.read().decode(errors="replace").strip().splitlines()
        return lines[-1][:300] if lines else ""

    def end(self) -> None:
        self._finalizer()
        self._stderr.close()

    def forget(self) -> None:
        """Let go of a process that belongs to the parent of this one."""
        self._finalizer.detach()
        for stream in (self.process.stdin, self.process.stdout, self._stderr):
            if stream is not None:
                stream.close()
        self.process.returncode = 0  # not our child: nothing to wait for


def _end_process(process: subprocess.Popen[bytes], owner_pid: int) -> None:
    """End of input ends an idle solver; one that is busy is killed: nobody wants its result."""
    if owner_pid != os.getpid():
        return
    for stream in (process.stdin, process.stdout):
        if stream is not None:
            stream.close()
    try:
        process.wait(timeout=0.2)
    except subprocess.TimeoutExpired:
        process.kill()
        # A worker that is told to end does this in a signal handler. The code that was interrupted may hold the lock
        # that `wait` wants, and never let go of it: so not for ever.
        with suppress(subprocess.TimeoutExpired):
            process.wait(timeout=0.5)


def signal_name(number: int) -> str:
    """`SIGSEGV` for 11."""
    try:
        return signal.Signals(number).name
    except ValueError:
        return str(number)
