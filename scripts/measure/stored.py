# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""Reading JSON that programs and earlier runs have written."""

import json
import pathlib

from . import parts


class Unreadable(Exception):
    """A file that can't be read or holds something else than expected."""


class Optional:
    """A member that may be missing."""

    def __init__(self, shape):
        self.shape = shape


class Number:
    """Not below `least`; true and false are none."""

    def __init__(self, least=0, above=False, or_none=False):
        self.least, self.above, self.or_none = least, above, or_none

    def check(self, value, place):
        if self.or_none and value is None:
            return
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise Unreadable(f"{place}: expected a number")
        if value < self.least or (self.above and value == self.least):
            raise Unreadable(f"{place}: {value}, expected {'more than' if self.above else 'at least'} {self.least}")


class Whole(Number):
    def check(self, value, place):
        super().check(value, place)
        if not isinstance(value, int):
            raise Unreadable(f"{place}: expected a whole number")


class OneOf:
    def __init__(self, names):
        self.names = names

    def check(self, value, place):
        if not isinstance(value, str) or value not in self.names:
            raise Unreadable(f"{place}: {value!r}, expected one of {', '.join(self.names)}")


class Text:
    def __init__(self, or_none=False):
        self.or_none = or_none

    def check(self, value, place):
        if not isinstance(value, str) and not (self.or_none and value is None):
            raise Unreadable(f"{place}: expected a text")


class Truth:
    def check(self, value, place):
        if not isinstance(value, bool):
            raise Unreadable(f"{place}: expected true or false")


class Several:
    """A list of the same."""

    def __init__(self, shape, least=0):
        self.shape, self.least = shape, least

    def check(self, value, place):
        if not isinstance(value, list) or len(value) < self.least:
            raise Unreadable(f"{place}: expected a list{' that is not empty' if self.least else ''}")
        for n, item in enumerate(value):
            check(item, self.shape, f"{place}[{n}]")


class Sample:
    """A slice read back, beside PrusaSlicer's where there is one."""

    def check(self, value, place):
        check(value, {}, place)
        if "bound_px" in value:
            check(value, {"apart_px": Number(), "bound_px": Number(above=True)}, place)


class Stage:
    """A line of Google Benchmark."""

    def check(self, value, place):
        check(value, {"program": Text(), "name": Text(), "runs": Several({}, 1)}, place)
        if value["program"] != "stages":
            return
        check(value["runs"], Several({"Mvoxel/s": Number(above=True)}), f"{place}.runs")
        threads = value["name"].partition("/threads:")[2].partition("/")[0]
        if "/threads:" in value["name"] and not (threads.isascii() and threads.isdigit()):
            raise Unreadable(f"{place}.name: {value['name']}, expected a number after 'threads:'")


def check(value, shape, place):
    """Raises `Unreadable` where `value` is not of the shape; more members than it has are fine."""
    if not isinstance(shape, dict):
        shape.check(value, place)
        return
    if not isinstance(value, dict):
        raise Unreadable(f"{place}: expected an object")
    for key, member in shape.items():
        if isinstance(member, Optional):
            if key not in value:
                continue
            member = member.shape
        if key not in value:
            raise Unreadable(f"{place}: no '{key}'")
        check(value[key], member, f"{place}.{key}" if place else key)


CASE = {"part": OneOf(parts.PARTS), "display": OneOf(parts.DISPLAYS), "layer_um": Number(above=True)}
TOOK = {"wall_s": Number(above=True), "user_s": Number(), "system_s": Number(), "peak_mib": Number()}
COMPARED = {
    "slices": Whole(1),
    "samples": Several(Sample()),
}
# What compare_slices prints, and `run` and `verify` write.
COMPARISON = {**COMPARED, "wrong": Several(Text()), "bands": Whole(), "triangles": Whole()}
FIGURES = {
    key: Whole() for key in ("layers", "target_voxels", "printed_voxels", "cure_through_voxels", "undercure_voxels")
}
PROOF = {**FIGURES, "uncorrected": FIGURES}
# What --benchmark_out writes.
BENCHMARKS = {"benchmarks": Several({"name": Text()})}
PREDICTED = {
    "serial_share": Number(),
    "bands": Whole(),
    "speed": {n: Number() for n in ("2", "8", "16", "64")},
}
SCALING = {
    "words": Text(), "display": OneOf(parts.DISPLAYS), "triangles": Whole(), "slices": Whole(), "job": Text(),
    **TOOK, "predicted": Optional(PREDICTED),
}  # fmt: skip
RUN = {
    "machine": {
        "date": Text(),
        "commit": Text(),
        "changed_since_commit": Truth(),
        "cpu": Text(),
        "cores": Whole(1),
        "memory_gib": Number(or_none=True),
        "system": Text(),
        "compiler": Text(),
        "build_type": Text(),
    },
    "peer": Text(or_none=True),
    "quick": Truth(),
    "measurements": Several(
        {**CASE, "job": Text(), "antialias": Truth(), "threads": Whole(1), "runs": Several(TOOK, 1)}
    ),
    "outputs": Several(
        {**CASE, "on": Optional(COMPARED), "off": Optional(COMPARED), "verified": {"layers": Whole(1)}}
    ),
    "stages": Several(Stage()),
    "skipped": Several(Text()),
    "wrong": Several(Text()),
    "scaling": Optional(Several(SCALING)),
}


def load(path, shape):
    """A file of JSON of this shape."""
    try:
        text = pathlib.Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise Unreadable(f"{path}: can't be read: {getattr(error, 'strerror', None) or 'no UTF-8'}") from error
    return parse(text, shape, str(path))


def no_number(name):
    raise ValueError(f"{name} is no number")


def parse(text, shape, source):
    try:
        value = json.loads(text, parse_constant=no_number)
    except (ValueError, RecursionError) as error:
        raise Unreadable(f"{source}: no JSON: {error}") from error
    try:
        check(value, shape, "")
    except Unreadable as error:
        raise Unreadable(f"{source}: {str(error).removeprefix(': ')}") from error
    return value


def joined(portions):
    """Runs of one commit on one machine as one; each with the name of its file."""
    name, result = portions[0]
    for other_name, other in portions[1:]:
        for key in ("cpu", "cores", "commit"):
            if result["machine"][key] != other["machine"][key]:
                raise Unreadable(
                    f"{name} and {other_name} differ in {key}: {result['machine'][key]} and {other['machine'][key]}"
                )
        if "scaling" in result or "scaling" in other:
            raise Unreadable(f"{name} and {other_name}: runs of --scaling stand alone")
        for key in ("measurements", "outputs", "skipped", "stages", "wrong"):
            result[key] += other[key]
        result["quick"] = result["quick"] and other["quick"]
    return result
