#!/usr/bin/python3
"""Corrects an archive: correct.py IN OUT PRINTER RESIN SPEED_MM_H. IN and OUT may be the same file."""
import sys

import slicecorr

if __name__ == "__main__":
    if len(sys.argv) != 6:
        sys.exit(2)
    source, target, printer, resin, speed_mm_h = sys.argv[1:]
    try:
        figures = slicecorr.correct(source, target, printer=printer, resin=resin, speed_mm_h=speed_mm_h)
    except slicecorr.Error as error:
        print(f"correct.py: {error}", file=sys.stderr)
        sys.exit(error.status)
    print(f"mean height error {figures['height_error_um']['mean_abs']:.2f} um")
