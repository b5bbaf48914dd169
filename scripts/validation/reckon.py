# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""Tables, statistics and the laws in closed form: what is reckoned here shares no code with the programs."""
import csv
import math
import pathlib

MOST_BYTES = 10_000_000
MOST_ROWS = 100_000


class BadInput(Exception):
    """An input that can't be read or doesn't fit: the message names file, place and what was expected."""


class Refused(BadInput):
    """What a program said to a table that was made of an input, without its call."""

    def __init__(self, call, told):
        super().__init__(f"{call}: {told}")
        self.told = told


class Disagrees(Exception):
    """A program and the arithmetic here differ: a defect of ours."""


class Row(dict):
    """A line of a table: texts by column; `line` is its number in the file."""

    def __init__(self, path, line, texts):
        super().__init__(texts)
        self.path, self.line = path, line

    def number(self, column, least=-math.inf, most=math.inf):
        text = self.get(column, "")
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not (math.isfinite(value) and least <= value <= most):
            limits = "" if least == -math.inf else f" of {least:g} or more" if most == math.inf else f" from {least:g} to {most:g}"
            raise BadInput(f"{self.path}: line {self.line}: {column}: is '{text[:40]}'; expected a number{limits}")
        return value

    def above_zero(self, column):
        value = self.number(column, 0)
        if value == 0:
            raise BadInput(f"{self.path}: line {self.line}: {column}: is 0; expected a number above 0")
        return value

    def optional(self, column, default):
        return self.number(column) if self.get(column, "").strip() else default


def read_table(path):
    """Rows of a CSV with a header row; '#' starts a comment line. Names of columns in lower case."""
    path = pathlib.Path(path)
    try:
        raw = path.read_bytes()[:MOST_BYTES + 1]
    except OSError as e:
        raise BadInput(f"{path}: {e.strerror}") from e
    if len(raw) > MOST_BYTES:
        raise BadInput(f"{path}: is larger than {MOST_BYTES} bytes; expected a table of measurements")
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as e:
        raise BadInput(f"{path}: byte {e.start} is no text; expected UTF-8") from e
    if "\0" in text:
        raise BadInput(f"{path}: holds bytes that are no text")
    lines = [(n, line) for n, line in enumerate(text.splitlines(), 1) if line.strip() and not line.lstrip().startswith("#")]
    if not lines:
        raise BadInput(f"{path}: expected a header row and measurements below it")
    if len(lines) > MOST_ROWS:
        raise BadInput(f"{path}: has more than {MOST_ROWS} rows")
    heads = [h.strip().lower() for h in next(csv.reader([lines[0][1]]))]
    if len(heads) == 1 and any(mark in heads[0] for mark in ";\t"):
        raise BadInput(f"{path}: line {lines[0][0]}: columns are divided by semicolons or tabs; expected commas, and points in numbers")
    twice = sorted({h for h in heads if heads.count(h) > 1})
    if twice:
        raise BadInput(f"{path}: line {lines[0][0]}: column '{twice[0]}' is there twice")
    rows = []
    for n, line in lines[1:]:
        try:
            cells = next(csv.reader([line], strict=True))
        except csv.Error as e:
            raise BadInput(f"{path}: line {n}: {e}") from e
        if len(cells) != len(heads):
            raise BadInput(f"{path}: line {n}: has {len(cells)} fields; expected {len(heads)}, as the header row")
        rows.append(Row(str(path), n, dict(zip(heads, (c.strip() for c in cells)))))
    if not rows:
        raise BadInput(f"{path}: has no measurements below its header row")
    return heads, rows


def groups_of(rows, column):
    """Rows by the text of a column, in the order of the file; all under '' where the column is not there."""
    groups = {}
    for row in rows:
        groups.setdefault(row.get(column, ""), []).append(row)
    return groups


def mean(values):
    return sum(values) / len(values)


def rms(values):
    return math.sqrt(sum(v * v for v in values) / len(values))


def deviation(values):
    """Standard deviation of a sample."""
    m = mean(values)
    return math.sqrt(sum((v - m) ** 2 for v in values) / (len(values) - 1))


class Line:
    """Least squares of y over x: y = at + slope x."""

    def __init__(self, points):
        n = len(points)
        mx, my = mean([p[0] for p in points]), mean([p[1] for p in points])
        square = sum((x - mx) ** 2 for x, _ in points)
        self.slope = sum((x - mx) * (y - my) for x, y in points) / square
        self.at = my - self.slope * mx
        left = sum((y - self(x)) ** 2 for x, y in points)
        total = sum((y - my) ** 2 for _, y in points)
        self.r2 = 1 - left / total if total else math.nan
        self.sigma = math.sqrt(left / (n - 2)) if n > 2 else math.nan
        self.slope_error = self.sigma / math.sqrt(square)

    def __call__(self, x):
        return self.at + self.slope * x


def incomplete_beta(a, b, x):
    """I_x(a, b) by its continued fraction (Lentz)."""
    if x <= 0 or x >= 1:
        return float(x > 0)
    if x > (a + 1) / (a + b + 2):
        return 1 - incomplete_beta(b, a, 1 - x)
    front = math.exp(math.lgamma(a + b) - math.lgamma(a) - math.lgamma(b) + a * math.log(x) + b * math.log(1 - x)) / a
    f, c, d = 1.0, 1.0, 0.0
    for i in range(400):
        m = i // 2
        if i == 0:
            term = 1.0
        elif i % 2:
            term = -(a + m) * (a + b + m) * x / ((a + 2 * m) * (a + 2 * m + 1))
        else:
            term = m * (b - m) * x / ((a + 2 * m - 1) * (a + 2 * m))
        d = 1 + term * d
        d = 1 / (d if abs(d) > 1e-300 else 1e-300)
        c = 1 + term / (c if abs(c) > 1e-300 else 1e-300)
        f *= c * d
        if abs(1 - c * d) < 1e-14:
            break
    return front * (f - 1)


def student_t(freedom, share=0.975):
    """t that `share` of a Student's distribution lies below."""
    low, high = 0.0, 1e4
    for _ in range(200):
        t = (low + high) / 2
        below = 1 - 0.5 * incomplete_beta(freedom / 2, 0.5, freedom / (freedom + t * t))
        low, high = (t, high) if below < share else (low, t)
    return (low + high) / 2


def least(f, low, high, rounds=120):
    """Where a function with one valley is least (golden section)."""
    g = (math.sqrt(5) - 1) / 2
    a, b = high - g * (high - low), low + g * (high - low)
    fa, fb = f(a), f(b)
    for _ in range(rounds):
        if fa < fb:
            high, b, fb = b, a, fa
            a = high - g * (high - low)
            fa = f(a)
        else:
            low, a, fa = a, b, fb
            b = low + g * (high - low)
            fb = f(b)
    return (low + high) / 2


def jacobs_um(h_um, dc, dose):
    return h_um * math.log(dose / dc)


def fit_jacobs(points):
    """h and Dc of (dose, height): a straight line over ln dose."""
    line = Line([(math.log(dose), z) for dose, z in points])
    return line.slope, math.exp(-line.at / line.slope)


def gel_time_um(h_um, a, b, intensity, time):
    """Height at which t = A/i + B/sqrt(i) has passed, i the light there."""
    root = (b + math.sqrt(b * b + 4 * a * time)) / (2 * time)
    return h_um * math.log(intensity / (root * root))


def disagree(what, ours, theirs, tolerance):
    """Stops where a figure of a program is not that of the arithmetic here."""
    if not (math.isfinite(ours) and math.isfinite(theirs) and abs(ours - theirs) <= tolerance):
        raise Disagrees(f"{what}: the program says {theirs!r}, the arithmetic here {ours!r}")
