#!/usr/bin/python3
# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""Makes the pages of docs/ for a browser twice and holds them against what they promise: the same bytes, links and
anchors that lead somewhere, nothing from a network, and a search that works in Chromium from the disk. Usage:
docs_site.py ROOT. Prints what is wrong and ends with 1, else 0; without Chromium that part is left out and told."""

import filecmp
import html.parser
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import urllib.parse

ROOT = pathlib.Path(sys.argv[1])
wrong = []


class Links(html.parser.HTMLParser):
    def __init__(self):
        super().__init__()
        self.links, self.loaded, self.anchors = [], [], set()

    def handle_starttag(self, tag, attributes):
        values = dict(attributes)
        if "id" in values:
            if values["id"] in self.anchors:
                wrong.append(f"two places are called {values['id']}")
            self.anchors.add(values["id"])
        if tag == "a" and "href" in values:
            self.links.append(values["href"])
        if tag in ("img", "script", "iframe") and "src" in values:
            self.loaded.append(values["src"])
        if tag == "link":
            self.loaded.append(values["href"])


def make(folder):
    subprocess.run([sys.executable, ROOT / "scripts" / "docs-site", folder], check=True, stderr=subprocess.DEVNULL)


def read(page):
    parsed = Links()
    parsed.feed(page.read_text())
    return parsed


def check_links(site):
    pages = {page.name: read(page) for page in sorted(site.glob("*.html"))}
    if len(pages) < 50:
        wrong.append(f"{len(pages)} pages, expected those of docs/")
    for name, page in pages.items():
        for file in page.loaded:
            if ":" in file or not (site / file).is_file():
                wrong.append(f"{name} loads {file}")
        for link in page.links:
            if re.match(r"(https?|mailto):", link):
                continue
            target, _, anchor = link.partition("#")
            target = target or name
            if target not in pages:
                wrong.append(f"{name} links to {link}")
            elif anchor and urllib.parse.unquote(anchor) not in pages[target].anchors:
                wrong.append(f"{name} links to {link}, where there is no such place")
    for file in ("site.css", "search.js"):
        if re.search(r"@import|url\(|fetch\(|XMLHttpRequest|https?:", (site / file).read_text()):
            wrong.append(f"{file} loads something")
    # Every source has its page.
    for source in (ROOT / "docs").rglob("*.md"):
        name = "-".join(source.relative_to(ROOT / "docs").parts)[:-3].lower() + ".html"
        if name not in pages:
            wrong.append(f"{source.relative_to(ROOT)} has no page")


def check_search(site):
    chromium = shutil.which("chromium-headless-shell") or shutil.which("chromium")
    if chromium is None:
        print("chromium is not installed: the search was not tried")
        return
    with tempfile.TemporaryDirectory() as profile:
        for words, first in (("backup repair farm", "farm-backup.html"), ("register map", "printer-files.html"),
                             ("what the page shows", "report.html#what-the-page-shows"),
                             ("xyzzyplugh", "Nothing found")):
            url = (site / "index.html").as_uri() + "?q=" + urllib.parse.quote(words)
            command = [chromium, "--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={profile}",
                       "--virtual-time-budget=10000", "--dump-dom", url]
            dom = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False).stdout
            found = re.search(r'<div id="found".*?</form>', dom, re.S)
            hits = re.findall(r'href="([^"]*)"', found.group(0))[:3] if found else []
            if not (any(hit.startswith(first) for hit in hits) or (found and first in found.group(0))):
                wrong.append(f"'{words}' finds {hits}, expected {first} among the first three")


def main():
    with tempfile.TemporaryDirectory() as folder:
        one, two = pathlib.Path(folder) / "one", pathlib.Path(folder) / "two"
        make(one)
        make(two)
        names = sorted(p.name for p in one.iterdir())
        if names != sorted(p.name for p in two.iterdir()) or filecmp.cmpfiles(one, two, names, shallow=False)[1:] != ([], []):
            wrong.append("two runs differ")
        check_links(one)
        check_search(one)
    for line in wrong:
        print(line)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
