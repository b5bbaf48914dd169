# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""What programs of cases share: each case is a function that asks programs and notes what is wrong; a line of JSON says
what a case came to."""

import json


def add_options(parser):
    parser.add_argument("--json", help="also write the lines here")
    parser.add_argument("cases", nargs="*", metavar="CASE")


def run_cases(options, cases, begin, ask, told):
    """Runs the cases that options name, or all: begin() makes one, ask(function, case) runs it, told(case) are its
    figures. The code that a program ends with."""
    wrong = 0
    for name in options.cases or cases:
        case = begin()
        try:
            ask(cases[name], case)
        finally:
            case.end()
        line = {"case": name, **told(case), "wrong": case.wrong}
        wrong += len(case.wrong)
        print(json.dumps(line), flush=True)
        if options.json:
            with open(options.json, "a") as file:
                file.write(json.dumps(line) + "\n")
    return 1 if wrong else 0
