# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""Tomographic printing: the pair of operators, the solver, and jobs.

Arrays are NumPy's. *Volumes* have the axes (z, y, x), the lowest slice first; *light* has (z, angle, pixel): slice k
of a volume and slice k of light belong together. With one slice the axis z may be left out of what is passed, and is
then left out of what is returned. float32 and float64 arrays are read and written where they are, whatever their
strides; other real numbers are copied to float32 first. What is computed has single precision.

*Parts* are uint8 (255 part, 0 empty, between them neither) or bool, *inserts* uint8 (above 0 opaque) or bool.

Geometry, units and equations: docs/tomography.md and slicecorr.h. At angle m, th = 2 pi m / angles, a point (x, y) of
the part lies at t = x cos th + y sin th; light of pixel i runs along t = (i - (pixels - 1) / 2) pixel_mm.
"""

from __future__ import annotations

import ctypes
import functools
import os
from typing import TYPE_CHECKING, Any, Callable, Optional, Tuple, Union

import numpy as np

from ._library import (
    Array,
    Definition,
    Figures,
    Handle,
    InputError,
    Progress,
    Run,
    TomoGrid,
    check,
    figures_of,
    function,
    setup_of,
)

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, DTypeLike, NDArray
    from scipy.sparse.linalg import LinearOperator

    Path = Union[str, "os.PathLike[str]"]
    Notice = Callable[[str], Any]

__all__ = ["Projector", "TomoJob", "job_of_light", "load", "solve"]

_TYPES = {np.dtype(np.uint8): 1, np.dtype(np.float32): 2, np.dtype(np.float64): 3}
#: Voxel-angles above which an operator takes so long (some 0.05 s) that Ctrl-C should reach it.
_LONG = 1_000_000_000


def _array(values: NDArray[Any]) -> Array:
    """`values`, of three axes and a type that the library knows, as it stands in memory. Keep `values` alive."""
    return Array(ctypes.sizeof(Array), _TYPES[values.dtype], 0, values.ctypes.data, values.shape, values.strides)


def _numbers(values: ArrayLike, name: str) -> NDArray[Any]:
    """As float32 or float64, copied only where it is something else."""
    array = np.asarray(values)
    if array.dtype in _TYPES and array.dtype.kind == "f":
        return array
    if array.dtype.kind == "f":
        return array.astype(np.float64 if array.dtype.itemsize >= 8 else np.float32)
    if array.dtype.kind in "biu":
        return array.astype(np.float32)
    raise TypeError(f"{name} has numbers of type {array.dtype}; expected real numbers")


def _bytes(values: ArrayLike, name: str, one: int) -> NDArray[np.uint8]:
    """As uint8, in which True is `one`."""
    array = np.asarray(values)
    if array.dtype == np.bool_:
        return array * np.uint8(one)
    if array.dtype == np.uint8:
        return array
    raise TypeError(f"{name} has numbers of type {array.dtype}; expected uint8 or bool")


def _three_axes(array: NDArray[Any], name: str) -> NDArray[Any]:
    if array.ndim == 2:
        return array[np.newaxis]
    if array.ndim == 3:
        return array
    raise ValueError(f"{name} has {array.ndim} axes; expected three, or two for one slice")


def _insert(values: Optional[ArrayLike]) -> Optional[NDArray[np.uint8]]:
    return None if values is None else _three_axes(_bytes(values, "insert", 1), "insert")


def _optional(array: Optional[NDArray[Any]]) -> Optional[Array]:
    return None if array is None else _array(array)


class _Properties:
    """What benches and jobs say of themselves."""

    _kind: str
    _handle: Handle

    def _number(self, name: str) -> float:
        value = ctypes.c_double()
        check(function(self._kind + "_number")(self._handle, name.encode(), ctypes.byref(value)))
        return value.value

    @functools.cached_property
    def voxels(self) -> int:
        """Voxels along x and along y."""
        return int(self._number("voxels"))

    @functools.cached_property
    def slices(self) -> int:
        """Slices along z."""
        return int(self._number("slices"))

    @functools.cached_property
    def rows(self) -> int:
        """Rows of light: the slices; where slices share light, those of the image."""
        return int(self._number("rows"))

    @functools.cached_property
    def angles(self) -> int:
        """Frames of a turn."""
        return int(self._number("angles"))

    @functools.cached_property
    def pixels(self) -> int:
        """Pixels along t."""
        return int(self._number("pixels"))

    @functools.cached_property
    def voxel_mm(self) -> float:
        """Side of a voxel."""
        return self._number("voxel_mm")

    @functools.cached_property
    def turn_s(self) -> float:
        """Time of a turn; NaN for a projector of plain numbers."""
        return self._number("turn_s")

    @property
    def volume_shape(self) -> Tuple[int, int, int]:
        """(slices, voxels, voxels): z, y, x."""
        return (self.slices, self.voxels, self.voxels)

    @property
    def light_shape(self) -> Tuple[int, int, int]:
        """(rows, angles, pixels): z, angle, t. Rows are the slices; where these share light, those of the image."""
        return (self.rows, self.angles, self.pixels)


class Projector(_Properties):
    """The pair of operators of tomographic printing, exact transposes of each other.

    `forward`, A, sums a volume along the lines of light; `adjoint`, A^T, is the dose of light, in units of light times
    angles: `adjoint(light) / angles` is its mean over the turn. Light dims by e^(-absorption times its way through the
    resin, in cm) to each voxel. Voxels further than `radius_mm` from the axis count for nothing and get 0.

    Plain numbers make a bench in a bath of the resin's index; `for_printer` that of a printer and a resin.
    A projector never changes and may be used by several threads at once.
    """

    _kind = "tomo_bench"

    def __init__(self, voxels: int, angles: int, *, slices: int = 1, pixels: Optional[int] = None,
                 radius_mm: float = 1.0, pixel_mm: Optional[float] = None, absorption_per_cm: float = 0.0,
                 insert: Optional[ArrayLike] = None, threads: int = 0):
        """`voxels` x `voxels` voxels whose middles are points from -radius_mm to radius_mm; `pixels` and `pixel_mm`
        as the voxels where not given. `threads` 0: all cores; results do not depend on it."""
        grid = TomoGrid(ctypes.sizeof(TomoGrid), voxels, slices, angles, pixels or 0, radius_mm, pixel_mm or 0.0,
                        absorption_per_cm)
        opaque = _insert(insert)
        handle = Handle("tomo_bench")
        check(function("tomo_bench_create")(grid, _optional(opaque), handle.out))
        self._take(handle, threads)

    def _take(self, handle: Handle, threads: int) -> None:
        self._handle, self._threads = handle, threads
        self._is_long = self.slices * self.angles * self.voxels**2 > _LONG

    @classmethod
    def for_printer(cls, printer: Definition, resin: Definition, voxel_mm: float, *, slices: int = 1,
                    angles: Optional[int] = None, insert: Optional[ArrayLike] = None, threads: int = 0,
                    **settings: Any) -> Projector:
        """The bench of a printer and a resin (names, paths of .toml files, or `slicecorr.Toml`): voxels of `voxel_mm`
        fill the resin from the axis to the wall, which refracts, reflects and absorbs as the files say. Light is
        in mW/cm² at the plane of the axis, without vial; `turn_mj_cm3 * adjoint(light)` is the dose of a turn."""
        setup = setup_of({"printer": printer, "resin": resin, "voxel_mm": voxel_mm, "angles": angles, **settings})
        opaque = _insert(insert)
        handle = Handle("tomo_bench")
        check(function("tomo_bench_new")(setup, slices, _optional(opaque), handle.out))
        made = cls.__new__(cls)
        made._take(handle, threads)
        return made

    @functools.cached_property
    def radius_mm(self) -> float:
        """Distance of the outermost voxels from the axis."""
        return self._number("radius_mm")

    @functools.cached_property
    def pixel_mm(self) -> float:
        """From one pixel's line to the next, in the resin."""
        return self._number("pixel_mm")

    @functools.cached_property
    def absorption_per_cm(self) -> float:
        """Of the resin, base e."""
        return self._number("absorption_per_cm")

    @functools.cached_property
    def alpha_r(self) -> float:
        """Absorption times the resin's radius."""
        return self._number("alpha_r")

    @functools.cached_property
    def reach_mm(self) -> float:
        """Radius up to which light comes from all directions; NaN for plain numbers."""
        return self._number("reach_mm")

    @functools.cached_property
    def turn_mj_cm3(self) -> float:
        """Dose of one turn for each unit of A^T of light in mW/cm²; NaN for plain numbers."""
        return self._number("turn_mj_cm3")

    @functools.cached_property
    def to_gel_mj_cm3(self) -> float:
        """Dose that gels; NaN for plain numbers."""
        return self._number("to_gel_mj_cm3")

    @functools.cached_property
    def black_mw_cm2(self) -> float:
        """Light of the darkest grey level; NaN for plain numbers."""
        return self._number("black_mw_cm2")

    @functools.cached_property
    def most_mw_cm2(self) -> float:
        """Light of the brightest grey level; NaN for plain numbers."""
        return self._number("most_mw_cm2")

    @property
    def angles_rad(self) -> NDArray[np.float64]:
        """th of every frame."""
        return 2 * np.pi * np.arange(self.angles) / self.angles

    @property
    def voxels_mm(self) -> NDArray[np.float64]:
        """x of the voxels' middles along x, and y along y."""
        return np.linspace(-self.radius_mm, self.radius_mm, self.voxels)

    @property
    def inside(self) -> NDArray[np.bool_]:
        """(voxels, voxels): which voxels of a slice count, being no further than `radius_mm` from the axis."""
        # In half voxels from the middle all is an integer.
        from_middle = 2 * np.arange(self.voxels, dtype=np.int64) - (self.voxels - 1)
        squares = from_middle**2
        return squares[:, np.newaxis] + squares <= (self.voxels - 1) ** 2

    def forward(self, volume: ArrayLike, out: Optional[NDArray[Any]] = None) -> NDArray[Any]:
        """Light = A volume: (rows, angles, pixels), float64 where `volume` is, else float32; or written to `out`."""
        return self._apply("tomo_forward", volume, "volume", self.volume_shape, out, "light", self.light_shape)

    def adjoint(self, light: ArrayLike, out: Optional[NDArray[Any]] = None) -> NDArray[Any]:
        """Dose = A^T light: (slices, voxels, voxels), float64 where `light` is, else float32; or written to `out`."""
        return self._apply("tomo_adjoint", light, "light", self.light_shape, out, "volume", self.volume_shape)

    def filtered_start(self, part: ArrayLike, window: str = "hamming") -> NDArray[np.float32]:
        """Light of a part by filtered back projection, nothing below 0, scaled to 1 at most. `window`: hamming,
        ram-lak, kelly. Does not see the insert."""
        given = _bytes(part, "part", 255)
        design = _three_axes(given, "part")
        light = np.empty(self.light_shape, np.float32)
        Run(self._threads).call("tomo_filtered_start", self._handle, _array(design), window.encode(), _array(light), ...)
        return light[0] if given.ndim == 2 else light

    def as_linear_operator(self, dtype: DTypeLike = np.float64) -> LinearOperator:
        """A as SciPy's LinearOperator, from raveled volumes to raveled light; its `.T` is A^T. Needs SciPy."""
        from scipy.sparse.linalg import LinearOperator

        def apply(operator: Callable[..., NDArray[Any]], shape: Tuple[int, ...], values: NDArray[Any]) -> NDArray[Any]:
            return operator(np.asarray(values, dtype).reshape(shape)).ravel()

        return LinearOperator(
            shape=(int(np.prod(self.light_shape)), int(np.prod(self.volume_shape))),
            matvec=lambda values: apply(self.forward, self.volume_shape, values),
            rmatvec=lambda values: apply(self.adjoint, self.light_shape, values),
            dtype=np.dtype(dtype),
        )

    def _apply(self, name: str, values: ArrayLike, what: str, shape: Tuple[int, int, int],
               out: Optional[NDArray[Any]], out_what: str, out_shape: Tuple[int, int, int]) -> NDArray[Any]:
        given = _numbers(values, what)
        flat = given.ndim == 2 and self.slices == 1
        given_shape, expected = given.shape, shape[1:] if flat else shape
        if given_shape != expected:
            raise InputError(f"{what} has the shape {given_shape}; expected {expected}", 2)
        if out is None:
            result = np.empty(out_shape[1:] if flat else out_shape, given.dtype)
        else:
            result = out
            if not isinstance(out, np.ndarray) or out.dtype not in _TYPES or out.dtype.kind != "f":
                raise TypeError("out must be an array of float32 or float64")
            if out.shape != (out_shape[1:] if flat else out_shape):
                raise InputError(f"out has the shape {out.shape}; expected {out_shape[1:] if flat else out_shape}", 2)
            if not out.flags.writeable:
                raise ValueError("out is read-only")
            if np.may_share_memory(out, given):
                raise ValueError(f"out shares memory with {what}")
        three, to = (given[np.newaxis], result[np.newaxis]) if flat else (given, result)
        if self._is_long or self._threads:
            Run(self._threads).call(name, self._handle, _array(three), _array(to), ..., short=not self._is_long)
        else:
            check(function(name)(self._handle, _array(three), _array(to), None))
        return result


class TomoJob(_Properties):
    """Frames of a turn with the printer, the resin and the part that they are for: what `slicecorr tomo` writes as
    .frames. Made by `solve`, `load` and `job_of_light`; never changes."""

    _kind = "tomo_job"

    def __init__(self, handle: Handle, figures: Optional[Figures], threads: int):
        self._handle, self._threads = handle, threads
        if figures is not None:
            self.__dict__["figures"] = figures

    @functools.cached_property
    def turns(self) -> int:
        """Whole turns of the print."""
        return int(self._number("turns"))

    @functools.cached_property
    def print_time_s(self) -> float:
        return self._number("print_time_s")

    @functools.cached_property
    def frame_shape(self) -> Tuple[int, int]:
        """(rows, columns) of a frame: the projector's size."""
        return (int(self._number("height_px")), int(self._number("width_px")))

    @functools.cached_property
    def clockwise(self) -> bool:
        """How the vial turns, seen from above. Clockwise frame f is shown at angle f, else at angle -f."""
        return bool(self._number("clockwise"))

    @functools.cached_property
    def figures(self) -> Figures:
        """What the frames print, with the keys of `slicecorr tomo verify --json`. Only a job that was solved in this
        process has a `contrast_bound`."""
        return self.verify()

    @functools.cached_property
    def frames(self) -> NDArray[np.uint8]:
        """(angles, rows, columns): all frames in the order in which they are shown, as seen from the projector."""
        frames = np.empty((self.angles, *self.frame_shape), np.uint8)
        Run(self._threads).call("tomo_job_frames", self._handle, 0, _array(frames), ...)
        return frames

    def frame(self, number: int) -> NDArray[np.uint8]:
        """(rows, columns) of one frame, without making the others."""
        frames = np.empty((1, *self.frame_shape), np.uint8)
        Run(self._threads).call("tomo_job_frames", self._handle, number, _array(frames), ..., short=True)
        return frames[0]

    def light(self) -> NDArray[np.float32]:
        """What the frames show, mW/cm²: (rows, angles, pixels), as `Projector.for_printer` takes it."""
        light = np.empty(self.light_shape, np.float32)
        Run(self._threads).call("tomo_job_light", self._handle, _array(light), ..., short=True)
        return light

    @functools.cached_property
    def part(self) -> NDArray[np.uint8]:
        """(slices, voxels, voxels): what the frames are for, middled in the vial."""
        part = np.empty(self.volume_shape, np.uint8)
        Run(self._threads).call("tomo_job_part", self._handle, _array(part), ..., short=True)
        return part

    def dose(self, progress: Optional[Progress] = None) -> NDArray[np.float32]:
        """Dose of the whole print, mJ/cm³: (slices, voxels, voxels). A sum over all angles in double precision,
        which shares nothing with the projector."""
        dose = np.empty(self.volume_shape, np.float32)
        Run(self._threads, progress).call("tomo_job_dose", self._handle, _array(dose), ...)
        return dose

    def verify(self, part: Optional[ArrayLike] = None, progress: Optional[Progress] = None) -> Figures:
        """What the frames print by these doses, judged against `part`, a square of any size, or the job's own."""
        design = None if part is None else _three_axes(_bytes(part, "part", 255), "part")
        figures = Handle("figures")
        Run(self._threads, progress).call("tomo_verify", self._handle, _optional(design), ..., figures.out)
        return figures_of(figures)

    def save(self, path: Path) -> None:
        """Writes the job as a file (.frames), whole or not at all. The same job gives the same bytes, which are those
        of `slicecorr tomo solve`."""
        Run(self._threads).call("tomo_job_write", self._handle, os.fsencode(path), ...)


def solve(part: ArrayLike, voxel_mm: float, printer: Definition, resin: Definition, *,
          insert: Optional[ArrayLike] = None, method: Optional[str] = None, window: Optional[str] = None,
          angles: Optional[int] = None, iterations: Optional[int] = None, max_time_s: Optional[float] = None,
          beyond_reach: bool = False, threads: int = 0, progress: Optional[Progress] = None,
          notice: Optional[Notice] = None, **settings: Any) -> TomoJob:
    """Finds the frames of a part, as `slicecorr tomo solve --volume` does.

    `part` is a square of any size, (z, y, x), middled on the axis with nothing around it; so is `insert`, which is
    opaque and turns with it. `printer` and `resin` are names, paths of .toml files, or `slicecorr.Toml`. `method` is
    ladder (the default), osmo, kelly or fbp, `window` hamming, ram-lak or kelly; other settings (`clip_sigma`,
    `stop_error`) are those of slicecorr.h.

    Where void gels with the part, or some of the part does not, the job comes all the same and
    ``figures["feasible"]`` is False. Raises `InfeasibleError` with what is in the way where no light prints it,
    `InputError` for what does not fit; Ctrl-C and exceptions of `progress` and `notice` end it."""
    design = _three_axes(_bytes(part, "part", 255), "part")
    opaque = _insert(insert)
    setup = setup_of({"printer": printer, "resin": resin, "voxel_mm": voxel_mm, "angles": angles, "method": method,
                      "window": window, "iterations": iterations, "max_time_s": max_time_s,
                      "beyond_reach": "allow" if beyond_reach else None, **settings})
    job, figures = Handle("tomo_job"), Handle("figures")
    Run(threads, progress, notice).call("tomo_solve", _array(design), _optional(opaque), setup, ..., job.out,
                                        figures.out)
    return TomoJob(job, figures_of(figures), threads)


def load(path: Path, *, threads: int = 0) -> TomoJob:
    """Reads a job from its file."""
    job = Handle("tomo_job")
    Run(threads).call("tomo_job_open", os.fsencode(path), ..., job.out)
    return TomoJob(job, None, threads)


def job_of_light(light: ArrayLike, part: ArrayLike, voxel_mm: float, printer: Definition, resin: Definition, *,
                 turns: int, insert: Optional[ArrayLike] = None, threads: int = 0, **settings: Any) -> TomoJob:
    """A job of light that you found yourself, mW/cm², on the bench that `Projector.for_printer` makes of the same
    printer, resin and voxels: (rows, angles, pixels). Each number is shown as the nearest grey level, for `turns`
    whole turns. Its `figures` judge it like any other job."""
    numbers = _three_axes(_numbers(light, "light"), "light")
    design = _three_axes(_bytes(part, "part", 255), "part")
    opaque = _insert(insert)
    setup = setup_of({"printer": printer, "resin": resin, "voxel_mm": voxel_mm, **settings})
    job = Handle("tomo_job")
    check(function("tomo_job_of_light")(_array(design), _optional(opaque), _array(numbers), turns, setup, job.out))
    return TomoJob(job, None, threads)
