# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""Archives of slices."""

from __future__ import annotations

import ctypes
import os
from typing import Any, Callable, Optional, Sequence, Union

from ._library import Definition, Figures, Handle, Progress, Run, check, figures_of, function, setup_of


def correct(source: "Union[str, os.PathLike[str]]", target: "Union[str, os.PathLike[str]]", *,
            printer: Optional[Definition] = None, resin: Optional[Definition] = None, threads: int = 0,
            progress: Optional[Progress] = None, notice: Optional[Callable[[str], Any]] = None,
            **settings: Any) -> Figures:
    """Corrects the archive `source` and writes `target`, which may be the same file.

    `printer` and `resin` are names, paths of .toml files, or `Toml`; other settings are those of `slicecorr correct`
    with _ for - (``speed_mm_h=800``), but for `part_inside`, its --part: the path of the mesh that `source` was sliced
    from, or a list of them; supports beside it stay as they are. `progress` is called with a stage and the fraction done. Returns what the
    corrected stack prints, as `slicecorr verify --json` writes it. Raises `InputError`, `InfeasibleError`,
    `DeviceError`; after Ctrl-C nothing half-made is left."""
    setup = setup_of({"printer": printer, "resin": resin, **settings})
    stack, after = Handle("stack"), Handle("figures")
    check(function("stack_open")(os.fsencode(source), stack.out))
    Run(threads, progress, notice).call("correct", stack, setup, os.fsencode(target), ..., after.out, None)
    return figures_of(after)


def scan_compare(scan: "Union[str, os.PathLike[str]]", stack: "Union[str, os.PathLike[str]]", *,
                 printer: Optional[Definition] = None, resin: Optional[Definition] = None, threads: int = 0,
                 progress: Optional[Progress] = None, notice: Optional[Callable[[str], Any]] = None,
                 **settings: Any) -> Figures:
    """Lays the scan of a print onto what `stack`, which was printed, is predicted to print, and measures how far it is off.

    `printer` and `resin` replace those that the stack has in it. `design` is the path of the mesh that was sliced, by
    which it is measured, too, `scan_unit` and `voxel_um` say what the scan's numbers are. Returns the figures of
    `slicecorr scan compare --json`. Raises `InputError` for a scan of another part."""
    setup = setup_of({"printer": printer, "resin": resin, **settings})
    printed, figures = Handle("stack"), Handle("figures")
    check(function("stack_open")(os.fsencode(stack), printed.out))
    Run(threads, progress, notice).call("scan_compare", os.fsencode(scan), printed, setup, ..., figures.out)
    return figures_of(figures)


def tune_scans(scans: "Sequence[Union[str, os.PathLike[str]]]", stack: "Union[str, os.PathLike[str]]", *,
               printer: Definition, resin: Definition, threads: int = 0,
               progress: Optional[Progress] = None, notice: Optional[Callable[[str], Any]] = None,
               **settings: Any) -> Figures:
    """Finds what of `printer` and `resin`, as they were believed, explains `scans` of prints of `stack`.

    `scan_unit` and `voxel_um` say what the scans' numbers are. Returns what was found: "inputs", each with its change,
    its sd before and now and whether the scans tell it; how far the surface is off as a whole before and after
    ("rms_before_um", "rms_after_um"), "unexplained" places, "text" for people, and "resin_toml" and "printer_toml", the
    files with what was found: `Toml` takes them for the next `correct`. Raises `InputError` for a scan of another part."""
    setup = setup_of({"printer": printer, "resin": resin, **settings})
    printed, figures = Handle("stack"), Handle("figures")
    check(function("stack_open")(os.fsencode(stack), printed.out))
    paths = (ctypes.c_char_p * len(scans))(*map(os.fsencode, scans))
    Run(threads, progress, notice).call("tune_scans", paths, len(scans), printed, setup, ..., figures.out)
    return figures_of(figures)
