#!/usr/bin/env python3
"""Corrects an archive: correct.py IN OUT PRINTER RESIN SPEED_MM_H. IN and OUT may be the same file."""
import ctypes
import json
import os
import sys

lib = ctypes.CDLL(os.environ.get("SLICECORR_LIBRARY", "libslicecorr.so.0"))
lib.slicecorr_setup_new.restype = ctypes.c_void_p
lib.slicecorr_error_text.restype = ctypes.c_char_p
lib.slicecorr_figures_json.restype = ctypes.c_char_p
for name in ("setup_free", "stack_free", "figures_free", "figures_json"):
    getattr(lib, "slicecorr_" + name).argtypes = [ctypes.c_void_p]
lib.slicecorr_setup_set_text.argtypes = [ctypes.c_void_p, ctypes.c_char_p, ctypes.c_char_p]
lib.slicecorr_stack_open.argtypes = [ctypes.c_char_p, ctypes.c_void_p]
lib.slicecorr_correct.argtypes = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_char_p] + [ctypes.c_void_p] * 3


class SlicecorrError(Exception):
    def __init__(self, status):
        super().__init__(lib.slicecorr_error_text().decode())
        self.status = status


def call(function, *arguments):
    status = function(*arguments)
    if status != 0:
        raise SlicecorrError(status)


def correct(source, target, settings):
    """Returns the figures of the corrected stack, as `slicecorr verify --json` writes them."""
    setup, stack, after = lib.slicecorr_setup_new(), ctypes.c_void_p(), ctypes.c_void_p()
    try:
        for name, value in settings.items():
            call(lib.slicecorr_setup_set_text, setup, name.encode(), str(value).encode())
        call(lib.slicecorr_stack_open, os.fsencode(source), ctypes.byref(stack))
        call(lib.slicecorr_correct, stack, setup, os.fsencode(target), None, ctypes.byref(after), None)
        return json.loads(lib.slicecorr_figures_json(after))
    finally:
        lib.slicecorr_figures_free(after)
        lib.slicecorr_stack_free(stack)
        lib.slicecorr_setup_free(setup)


if __name__ == "__main__":
    if len(sys.argv) != 6:
        sys.exit(2)
    keys = ("printer", "resin", "speed_mm_h")
    try:
        figures = correct(sys.argv[1], sys.argv[2], dict(zip(keys, sys.argv[3:])))
    except SlicecorrError as error:
        print(f"correct.py: {error}", file=sys.stderr)
        sys.exit(error.status)
    print(f"mean height error {figures['height_error_um']['mean_abs']:.2f} um")
