# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""A farm with very many queued jobs, made of one that was submitted; the record's own triggers count them."""

import os
import sqlite3

from docs_machine_faults import box_stl
from kills_parts import LIGHT, SPEED

WORKS, USERS = 500, 10


def make(programs, jobs):
    box_stl(programs.path("part.stl"), 1, 1.5, 0.5)
    programs.sound("slicefarm", "submit", "part.stl", "--dir", "farm", "--layer-um", "50", *SPEED, *LIGHT)
    with sqlite3.connect(programs.path("farm/farm.sqlite")) as db:
        db.execute("PRAGMA synchronous = OFF")

        def columns(table):
            return [row[1] for row in db.execute(f"PRAGMA table_info({table})")]

        def multiplied(table, count, **other):
            names = [c for c in columns(table) if c != "id"]
            values = [other.get(c, f"t.{c}") for c in names]
            db.execute(f"WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n WHERE i < {count}) "
                       f"INSERT INTO {table}({', '.join(names)}) SELECT {', '.join(values)} FROM n, "
                       f"(SELECT * FROM {table} LIMIT 1) t")
        multiplied("works", WORKS, key="printf('%064x', i)")
        # As people submit: each job another name, a tenth of them with another priority, a third with a deadline.
        multiplied("jobs", jobs, name="printf('part-%07d', i)", user=f"printf('user-%d', i % {USERS})",
                   key=f"printf('%064x', 1 + i % {WORKS})", priority="(i % 10 = 0) * (i % 7)",
                   ready_by_ms="CASE WHEN i % 3 = 0 THEN t.submitted_ms + 60000 * (i % 1440) ELSE t.ready_by_ms END")
    return os.path.getsize(programs.path("farm/farm.sqlite"))
