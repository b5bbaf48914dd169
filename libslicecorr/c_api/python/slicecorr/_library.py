# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""The shared library: where it is, what its functions take, and what its codes become."""

from __future__ import annotations

import ctypes
import json
import os
import pathlib
import threading
from typing import Any, Callable, Dict, Mapping, Optional, Union

#: What this module calls; older libraries lack some of it.
ABI_VERSION = 2

Figures = Dict[str, Any]
#: Called with the name of a stage and the fraction done, from any thread, never two at once.
Progress = Callable[[str, float], Any]
Definition = Union[str, "os.PathLike[str]", "Toml"]


class Toml(str):
    """The text of a printer or resin file, where else its name or path is taken."""


class Error(Exception):
    """What the library refuses or could not do; `status` is its code."""

    def __init__(self, text: str, status: int):
        super().__init__(text)
        self.status = status


class InputError(Error, ValueError):
    """An input that can't be read, is out of range or does not fit."""


class InfeasibleError(Error):
    """Physics forbids it; the text says what would make it feasible."""


class DeviceError(Error):
    """Disk full or unwritable, out of memory."""


class Cancelled(Error):
    """The caller stopped it."""


class BadCall(Error, TypeError):
    """This module and the library do not understand each other."""


_CLASSES = {2: InputError, 3: InfeasibleError, 4: DeviceError, 130: Cancelled, 200: BadCall}
_PROGRESS = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_char_p, ctypes.c_double)
_NOTICE = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_char_p)


class Array(ctypes.Structure):
    """slicecorr_array."""

    _fields_ = [
        ("struct_size", ctypes.c_size_t),
        ("type", ctypes.c_int32),
        ("reserved", ctypes.c_int32),
        ("data", ctypes.c_void_p),
        ("shape", ctypes.c_size_t * 3),
        ("strides", ctypes.c_ssize_t * 3),
    ]


class TomoGrid(ctypes.Structure):
    """slicecorr_tomo_grid."""

    _fields_ = [
        ("struct_size", ctypes.c_size_t),
        ("voxels", ctypes.c_int32),
        ("slices", ctypes.c_int32),
        ("angles", ctypes.c_int32),
        ("pixels", ctypes.c_int32),
        ("radius_mm", ctypes.c_double),
        ("pixel_mm", ctypes.c_double),
        ("absorption_per_cm", ctypes.c_double),
    ]


def library_path() -> str:
    """The library that is used: $SLICECORR_LIBRARY, else the one that was built or installed with this module, else
    the system's."""
    named = os.environ.get("SLICECORR_LIBRARY")
    if named:
        return named
    try:
        from ._location import LIBRARY
    except ImportError:
        return "libslicecorr.so.0"
    place = pathlib.Path(os.path.normpath(pathlib.Path(__file__).parent / LIBRARY))
    return str(place) if place.exists() else "libslicecorr.so.0"


def _load() -> ctypes.CDLL:
    path = library_path()
    try:
        loaded = ctypes.CDLL(path)
    except OSError as error:
        raise ImportError(f"{path} can't be loaded: {error}; $SLICECORR_LIBRARY names another") from None
    text, handle, out, array = ctypes.c_char_p, ctypes.c_void_p, ctypes.c_void_p, ctypes.POINTER(Array)
    integer, size, number = ctypes.c_int, ctypes.c_size_t, ctypes.POINTER(ctypes.c_double)
    free = (None, [handle])
    functions = {
        "version": (text, []),
        "abi_version": (integer, []),
        "error_text": (text, []),
        "setup_new": (handle, []),
        "setup_free": free,
        "setup_set_text": (integer, [handle, text, text]),
        "setup_set_numbers": (integer, [handle, text, number, size]),
        "job_new": (handle, []),
        "job_free": free,
        "job_set_threads": (integer, [handle, integer]),
        "job_set_progress": (integer, [handle, _PROGRESS, handle]),
        "job_set_notice": (integer, [handle, _NOTICE, handle]),
        "job_cancel": free,
        "stack_open": (integer, [text, out]),
        "stack_free": free,
        "correct": (integer, [handle, handle, text, handle, out, out]),
        "scan_compare": (integer, [text, handle, handle, handle, out]),
        "tune_scans": (integer, [ctypes.POINTER(text), size, handle, handle, handle, out]),
        "figures_json": (text, [handle]),
        "figures_free": free,
        "list_new": (integer, [text, out]),
        "list_count": (size, [handle]),
        "list_name": (text, [handle, size]),
        "list_free": free,
        "tomo_bench_create": (integer, [ctypes.POINTER(TomoGrid), array, out]),
        "tomo_bench_new": (integer, [handle, integer, array, out]),
        "tomo_bench_free": free,
        "tomo_bench_number": (integer, [handle, text, number]),
        "tomo_forward": (integer, [handle, array, array, handle]),
        "tomo_adjoint": (integer, [handle, array, array, handle]),
        "tomo_filtered_start": (integer, [handle, array, text, array, handle]),
        "tomo_solve": (integer, [array, array, handle, handle, out, out]),
        "tomo_job_of_light": (integer, [array, array, array, integer, handle, out]),
        "tomo_job_open": (integer, [text, handle, out]),
        "tomo_job_write": (integer, [handle, text, handle]),
        "tomo_job_free": free,
        "tomo_job_number": (integer, [handle, text, number]),
        "tomo_job_frames": (integer, [handle, integer, array, handle]),
        "tomo_job_light": (integer, [handle, array, handle]),
        "tomo_job_part": (integer, [handle, array, handle]),
        "tomo_job_dose": (integer, [handle, array, handle]),
        "tomo_verify": (integer, [handle, array, handle, out]),
    }
    known = int(loaded.slicecorr_abi_version())
    if known < ABI_VERSION:
        raise ImportError(f"{path} has interface {known}; expected {ABI_VERSION} or later")
    for name, (result, arguments) in functions.items():
        function = getattr(loaded, "slicecorr_" + name)
        function.restype, function.argtypes = result, arguments
    return loaded


_lib = _load()


def function(name: str) -> Any:
    """The C function slicecorr_`name`."""
    return getattr(_lib, "slicecorr_" + name)


def version() -> str:
    """That of the library, "0.1.0"."""
    return _lib.slicecorr_version().decode()


def check(status: int) -> None:
    """Raises what the last call of this thread returned, with its text."""
    if status != 0:
        text = _lib.slicecorr_error_text().decode(errors="replace")
        raise _CLASSES.get(status, Error)(text, status)


class Handle:
    """A handle of the library, freed with its object."""

    def __init__(self, kind: str, value: Optional[int] = None):
        self._free = function(kind + "_free")
        self.value = ctypes.c_void_p(value)

    @property
    def _as_parameter_(self) -> ctypes.c_void_p:
        return self.value

    def __del__(self) -> None:
        if getattr(self, "value", None):
            self._free(self.value)

    @property
    def out(self) -> Any:
        """Where a function puts a new handle."""
        return ctypes.byref(self.value)


def setup_of(settings: Mapping[str, Any]) -> Handle:
    """A setup of these settings; None means not set. Printers and resins may be paths, or `Toml`; lists are of numbers,
    or of paths."""
    setup = Handle("setup", _lib.slicecorr_setup_new())
    for name, value in settings.items():
        if value is None:
            continue
        if isinstance(value, Toml):
            name += "_toml"
        if isinstance(value, bool):
            raise TypeError(f"{name} is {value}; expected a text or a number")
        if isinstance(value, os.PathLike):
            value = os.fspath(value)
        if isinstance(value, (list, tuple)) and value and all(isinstance(v, (str, os.PathLike)) for v in value):
            paths = [os.fspath(v) for v in value]
            if any("\n" in path for path in paths):
                raise InputError(f"{name}: {paths} holds a path of several lines; expected none", 2)
            value = "\n".join(paths)
        if isinstance(value, (list, tuple)):
            numbers = (ctypes.c_double * len(value))(*value)
            check(_lib.slicecorr_setup_set_numbers(setup, name.encode(), numbers, len(value)))
            continue
        check(_lib.slicecorr_setup_set_text(setup, name.encode(), str(value).encode(errors="surrogateescape")))
    return setup


def figures_of(figures: Handle) -> Figures:
    """All figures, as the programs' --json writes them."""
    return json.loads(function("figures_json")(figures))


class Run:
    """How a long call runs and whom it tells: a slicecorr_job.

    A call that may take long runs in a thread of its own, so that the calling thread sees Ctrl-C, and an exception of
    `progress`, and can stop it."""

    def __init__(self, threads: int = 0, progress: Optional[Progress] = None,
                 notice: Optional[Callable[[str], Any]] = None):
        self._job = Handle("job", _lib.slicecorr_job_new())
        self._failure: Optional[BaseException] = None
        if threads:
            check(_lib.slicecorr_job_set_threads(self._job, threads))
        # Callbacks live as long as the job that knows them.
        self._progress = _PROGRESS(lambda _, stage, fraction: self._tell(progress, stage.decode(), fraction))
        self._notice = _NOTICE(lambda _, text: self._tell(notice, text.decode()) and None)
        if progress is not None:
            check(_lib.slicecorr_job_set_progress(self._job, self._progress, None))
        if notice is not None:
            check(_lib.slicecorr_job_set_notice(self._job, self._notice, None))

    def _tell(self, listener: Optional[Callable[..., Any]], *words: Any) -> int:
        if self._failure is not None or listener is None:
            return 1
        try:
            listener(*words)
            return 0
        except BaseException as failure:  # it must not cross the library
            self._failure = failure
            _lib.slicecorr_job_cancel(self._job)
            return 1

    def call(self, name: str, *arguments: Any, short: bool = False) -> None:
        """Calls slicecorr_`name`; the job stands where `...` does. `short`: in this thread."""
        c_function = function(name)
        passed = [self._job if a is Ellipsis else a for a in arguments]
        if short:
            self._finish(c_function(*passed), None)
            return
        ended: Dict[str, Any] = {}

        def work(_: Run = self) -> None:  # callbacks must live as long as this thread
            # The text of an error belongs to the thread.
            ended["status"] = c_function(*passed)
            ended["text"] = _lib.slicecorr_error_text().decode(errors="replace")

        thread = threading.Thread(target=work, name="slicecorr", daemon=True)
        thread.start()
        try:
            while thread.is_alive():
                # Signals are seen between waits.
                thread.join(0.2)
        except BaseException:
            _lib.slicecorr_job_cancel(self._job)
            thread.join()
            raise
        self._finish(ended["status"], ended["text"])

    def _finish(self, status: int, text: Optional[str]) -> None:
        if self._failure is not None:
            failure, self._failure = self._failure, None
            raise failure
        if status != 0 and text is not None:
            raise _CLASSES.get(status, Error)(text, status)
        check(status)
