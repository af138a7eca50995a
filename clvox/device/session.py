"""One device, its queue, its programs and its memory."""

from __future__ import annotations

import re
import threading
import warnings
from collections import deque
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any, TypeAlias

import numpy as np
import pyopencl as cl
import pyopencl.array as cla
from numpy.typing import DTypeLike, NDArray
from pyopencl.tools import ImmediateAllocator, MemoryPool

from clvox.device.choice import Device, DeviceLike, choose
from clvox.device.job import Job, Tick
from clvox.device.source import read_source
from clvox.errors import DeviceError, KernelBuildError, OutOfMemoryError

Argument: TypeAlias = "cla.Array | np.generic"
"""What a kernel takes: an array on the device, or a NumPy scalar, which has a width."""

GROUP = 64
"""Work-items per group, unless an operation says otherwise."""

STEPS_PER_LAUNCH = 1 << 26
"""About how many steps a launch has at most, unless its fewest work-items have more.

Meant to be less than half a second's work.
"""

ITEMS_PER_LAUNCH = 1 << 14
"""So many work-items a launch may have in any case, since fewer would not fill a GPU."""

AHEAD = 2
"""Launches that are queued at most: whoever interrupts the work waits for no more."""

_OPTIONS = ["-Werror"]
_YOUNG_PROCESSOR = (
    "The driver's compiler is older than this processor. Install a newer PoCL, or use Intel's "
    "driver: pip install 'clvox[intel]' and device=\"intel\" or CLVOX_DEVICE=intel."
)
_COMPLAINT = re.compile(r"\s*error:|.*:\d+:\d+: ")


class Session:
    """One device with one in-order queue.

    Work is queued a few launches ahead; whoever reads a result waits for it.  Memory comes from a
    pool, so that a second job of the same size allocates nothing new; `nbytes` counts what is in
    use, and a `job` what one piece of work takes.
    """

    def __init__(self, device: Device) -> None:
        if not device.handle.endian_little:
            raise DeviceError(f"{device} is big-endian; clvox needs a little-endian device")
        self.device = device
        self.builds = 0
        """Programs built so far."""
        self._lock = threading.RLock()
        self._context = cl.Context([device.handle])
        self._queue = cl.CommandQueue(self._context)
        self._pool = MemoryPool(ImmediateAllocator(self._queue))
        self._kernels: dict[tuple[Any, ...], cl.Kernel] = {}
        self._queued: deque[cl.Event] = deque()
        self._local = threading.local()

    def __repr__(self) -> str:
        return f"Session({self.device})"

    @property
    def nbytes(self) -> int:
        """Bytes of device memory in use."""
        return int(self._pool.active_bytes)

    @property
    def blocks(self) -> int:
        """Blocks of device memory allocated, in use or kept for the next job."""
        return int(self._pool.active_blocks + self._pool.held_blocks)

    @property
    def current_job(self) -> Job | None:
        """The job of this thread, if it has one."""
        job: Job | None = getattr(self._local, "job", None)
        return job

    @contextmanager
    def job(
        self, most: int, tick: Tick | None = None, held: Iterable[cla.Array] = ()
    ) -> Iterator[Job]:
        """Count what this thread allocates meanwhile, and refuse what takes more than *most* bytes.

        After an exception nothing that was allocated is in use any longer.

        Parameters
        ----------
        most : int
        tick : callable, optional
            Called between launches, apart from the job; may raise.
        held : arrays, optional
            Of an earlier job that this one goes on with: they count, too, and are given back.
        """
        outer, job = self.current_job, Job(most, tick)
        for array in held:
            job.hold(array, self.size_of(array.nbytes))
        self._local.job = job
        try:
            yield job
        except BaseException:
            try:
                self.finish()
            finally:
                job.abandon()
            raise
        finally:
            self._local.job = outer
            job.close()

    @contextmanager
    def apart(self) -> Iterator[None]:
        """Let this thread do what is no part of its job, such as what a caller's function does.

        It is not counted, not refused, not told of, and not given back if the job fails.
        """
        job = self.current_job
        self._local.job = None
        try:
            yield
        finally:
            self._local.job = job

    def free(self) -> None:
        """Give memory that is not in use back to the driver."""
        with self._lock:
            self._pool.free_held()

    def empty(self, shape: int | tuple[int, ...], dtype: DTypeLike) -> cla.Array:
        """Return an array on the device, its content undefined.

        Raises
        ------
        OutOfMemoryError
            The device does not allow a buffer of this size, or has no room left, or the job of this
            thread may not take so much.
        """
        nbytes = self.size_of(int(np.prod(shape, dtype=np.int64)) * np.dtype(dtype).itemsize)
        if nbytes > self.device.largest_allocation:
            raise OutOfMemoryError(
                f"an array of {nbytes:,} bytes is needed at once; {self.device} allows "
                f"{self.device.largest_allocation:,} per buffer. Use a coarser pitch or larger "
                "bricks."
            )
        job = self.current_job
        with self._lock:
            if job is not None:
                job.refuse(nbytes)
                held = self._pool.managed_bytes - self._pool.active_bytes
                if nbytes + held > job.left:
                    self._pool.free_held()
            try:
                array = cla.empty(self._queue, shape, dtype, allocator=self._pool)
            except (cl.MemoryError, cl.RuntimeError) as error:
                raise self._no_room(nbytes) from error
            if job is not None:
                job.hold(array, nbytes)
        return array

    def _no_room(self, nbytes: int) -> OutOfMemoryError:
        return OutOfMemoryError(
            f"{self.device} has no room for {nbytes:,} bytes more; {self.nbytes:,} are in use. Use "
            "a coarser pitch, or drop models that are no longer needed."
        )

    def size_of(self, nbytes: int) -> int:
        """Return how many bytes a buffer of *nbytes* takes: the pool rounds up, by a sixteenth."""
        return int(self._pool.alloc_size(self._pool.bin_number(nbytes))) if nbytes else 0

    def zeros(self, shape: int | tuple[int, ...], dtype: DTypeLike) -> cla.Array:
        """Return an array of whole 32-bit words on the device, cleared by a kernel of our own.

        Drivers' own fills reach half the speed of a kernel, and tools that watch memory do not
        count them as writes.
        """
        array = self.empty(shape, dtype)
        words, rest = divmod(array.nbytes, 4)
        if rest:
            raise TypeError(f"{array.nbytes} bytes are not whole words")
        if words:
            kernel = self.kernel("buffers/clear.cl", "clear")
            self.run(kernel, -(-words // 4), np.uint64(words), array, steps=4)
        return array

    def upload(self, host: NDArray[Any]) -> cla.Array:
        """Return a copy of *host* on the device."""
        array = self.empty(host.shape, host.dtype)
        if host.size:
            array.set(np.ascontiguousarray(host), self._queue)
        return array

    def share(self, host: NDArray[Any]) -> cla.Array:
        """Return *host* for kernels that only read: in place on a processor, else a copy.

        It counts as memory of the device either way.  Whoever calls keeps *host*, unchanged, until
        all is done that was queued with it.
        """
        if self.device.kind != "cpu" or not (host.size and host.flags.c_contiguous):
            return self.upload(host)
        nbytes, job = self.size_of(host.nbytes), self.current_job
        if job is not None:
            job.refuse(nbytes)
        flags = cl.mem_flags.READ_ONLY | cl.mem_flags.USE_HOST_PTR
        try:
            buffer = cl.Buffer(self._context, flags, hostbuf=host)
        except (cl.MemoryError, cl.RuntimeError) as error:
            raise self._no_room(nbytes) from error
        array = cla.Array(self._queue, host.shape, host.dtype, data=buffer)
        if job is not None:
            job.hold(array, nbytes)
        return array

    def kernel(self, file: str, name: str, **defines: int) -> cl.Kernel:
        """Return kernel *name* of *file*, built with *defines*; built once per session.

        Raises
        ------
        KernelBuildError
            The kernel does not build; the message holds the compiler's words.
        """
        key = (file, name, *sorted(defines.items()))
        with self._lock:
            if key not in self._kernels:
                program = self._build(file, defines)
                for kernel in program.all_kernels():
                    self._kernels[file, kernel.function_name, *sorted(defines.items())] = kernel
            return self._kernels[key]

    def run(
        self,
        kernel: cl.Kernel,
        count: int,
        *arguments: Argument,
        group: int | None = None,
        steps: int = 1,
    ) -> None:
        """Queue *kernel* for *count* work-items, rounded up to whole groups.

        Many of them are cut into launches, of `STEPS_PER_LAUNCH` steps but no fewer than
        `ITEMS_PER_LAUNCH` work-items; each work-item knows its number all the same.  A bare
        Python number is refused as an argument: it has no width.

        Parameters
        ----------
        group : int, optional
            Work-items in a group.
        steps : int
            About how many words, voxels or crossings one work-item looks at.
        """
        values = [_value(argument) for argument in arguments]
        size = min(group or GROUP, self.device.handle.max_work_group_size)
        items, job = -(-count // size) * size, self.current_job
        most = max(STEPS_PER_LAUNCH // steps, ITEMS_PER_LAUNCH) // size * size
        for first in range(0, items, most):
            with self._lock:
                # Arguments are state of the kernel object: set and queued under one lock.
                kernel.set_args(*values)
                event = cl.enqueue_nd_range_kernel(
                    self._queue, kernel, (min(most, items - first),), (size,), (first,)
                )
                self._queued.append(event)
                oldest = self._queued.popleft() if len(self._queued) > AHEAD else None
            if oldest is not None:
                oldest.wait()
            if job is not None:
                with self.apart():
                    job.tick()

    def finish(self) -> None:
        """Wait until everything queued is done."""
        self._queue.finish()
        with self._lock:
            # Another thread may be about to take the oldest.
            self._queued.clear()

    def _build(self, file: str, defines: dict[str, int]) -> cl.Program:
        # OpenCL C 1.2 is enough for every kernel; what a newer one offers is asked for by name.
        standard = "-cl-std=CL3.0" if "ATOMIC_LOADS" in defines else "-cl-std=CL1.2"
        given = [f"-D{name}={value}" for name, value in sorted(defines.items())]
        options = [standard, *_OPTIONS, *given]
        program = cl.Program(self._context, read_source(file))
        try:
            with warnings.catch_warnings():
                # What a compiler says of a program that it builds, in spite of -Werror, is chatter.
                warnings.simplefilter("ignore", cl.CompilerWarning)
                program.build(options)
        except cl.RuntimeError as error:
            lines = str(error).splitlines()
            words = [line for line in lines if _COMPLAINT.match(line)] or lines
            if "unknown target CPU" in str(error):
                words.append(_YOUNG_PROCESSOR)
            raise KernelBuildError(
                "\n    ".join(
                    [f"{file} does not build on {self.device} with {' '.join(options)}:", *words]
                )
            ) from error
        self.builds += 1
        return program


def _value(argument: Argument) -> Any:
    """What OpenCL is given for an argument."""
    if isinstance(argument, cla.Array):
        return argument.base_data
    if isinstance(argument, np.generic):
        return argument
    raise TypeError(f"a kernel takes arrays and NumPy scalars, not {argument!r}")


_sessions: dict[int, Session] = {}
_sessions_lock = threading.Lock()


def open_session(device: DeviceLike = None) -> Session:
    """Return this process's session for the device that is meant: see `choose`."""
    chosen = choose(device)
    with _sessions_lock:
        key = chosen.handle.int_ptr
        if key not in _sessions:
            _sessions[key] = Session(chosen)
        return _sessions[key]
