# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""Corrects slices for resin printers, and finds the light of tomographic prints.

``slicecorr.correct`` needs nothing but the standard library. ``slicecorr.tomo`` needs NumPy, and SciPy only where
it is asked for. Both call ``libslicecorr.so`` (docs/python.md, docs/c-api.md).
"""

from ._library import (
    BadCall,
    Cancelled,
    DeviceError,
    Error,
    Figures,
    InfeasibleError,
    InputError,
    Progress,
    Toml,
    library_path,
    version,
)
from .stacks import correct, scan_compare, tune_scans

__version__ = version()
__all__ = [
    "BadCall",
    "Cancelled",
    "DeviceError",
    "Error",
    "Figures",
    "InfeasibleError",
    "InputError",
    "Progress",
    "Toml",
    "correct",
    "library_path",
    "scan_compare",
    "tune_scans",
    "version",
]
