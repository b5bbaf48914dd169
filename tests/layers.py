#!/usr/bin/python3
# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""Reads the include graph and compares it with cmake/layers.txt.

A module may include itself and the modules listed above it; other components use public headers, the support layer
and, where they are programs, what programs share. A public header's functions and classes are defined in the module
that it is listed under. Texts of others are read by the readers that have bounds. Prints what is wrong and ends with 1, else 0."""

import collections
import pathlib
import re
import sys

ROOT = pathlib.Path(sys.argv[1] if len(sys.argv) > 1 else __file__).resolve()
ROOT = ROOT if ROOT.is_dir() else ROOT.parent.parent
SPACES = {"libslicecorr": "", "farm": "farm/", "firmware-bridge": "bridge/", "resins": "resins/"}
# What the programs of other components share with `slicecorr`.
PROGRAMS = "programs/common/"
wrong = []


def read_layers():
    components, below, current = {}, {}, None
    for line in (ROOT / "cmake/layers.txt").read_text().splitlines():
        line = line.strip()
        if not line or line.startswith("#"):
            continue
        if line.startswith("["):
            name, rest = line[1:].split("]")
            current = components[name] = {}
            below[name] = rest.split()
        else:
            module, headers = line.split(":")
            current[module] = headers.split()
    return components, below


def sources(component):
    for path in sorted((ROOT / component).rglob("*")):
        if path.suffix in (".cpp", ".hpp") and "examples" not in path.parts:
            yield path


def module_in(parts, modules):
    """The module that a file of these folders lies in: a folder of its own, or one within it that is listed."""
    within = "/".join(parts[:2])
    return within if within in modules else parts[0]


def module_of(component, path, homes, modules):
    parts = path.relative_to(ROOT / component).parts
    if parts[0] == "include":
        return homes.get("/".join(parts[1:]))
    return module_in(parts, modules) if len(parts) > 1 else None


def without_comments(text):
    return re.sub(r"//[^\n]*|/\*.*?\*/", "", text, flags=re.S)


def check_component(name, modules, below, components):
    order = {module: i for i, module in enumerate(modules)}
    homes = {}
    for module, headers in modules.items():
        for header in headers:
            key = f"slicecorr/{SPACES.get(name, '')}{header}.hpp"
            if key in homes:
                wrong.append(f"cmake/layers.txt: {header} is listed twice in [{name}]")
            homes[key] = module
    there = {str(p.relative_to(ROOT / name / "include")) for p in sources(name) if "include" in p.parts}
    for key in sorted(there - homes.keys()):
        wrong.append(f"{name}/include/{key}: in no module of cmake/layers.txt")
    for key in sorted(homes.keys() - there - {"slicecorr/version.hpp"}):
        wrong.append(f"cmake/layers.txt: [{name}] names {key}, which is not there")
    private = {str(p.relative_to(ROOT / "libslicecorr")) for p in sources("libslicecorr") if "include" not in p.parts}
    declared = {}
    for path in sources(name):
        text = path.read_text()
        module = module_of(name, path, homes, modules)
        place = path.relative_to(ROOT)
        if module is not None and module not in order:
            wrong.append(f"{place}: lies in no module of [{name}]")
            continue
        for include in re.findall(r'#include [<"]([^">]+)[">]', text):
            target = homes.get(include)
            if target is None and (ROOT / name / include).exists():
                target = module_in(include.split("/"), modules)
            if target is not None:
                if module is not None and order[target] > order[module]:
                    wrong.append(f"{place}: module {module} includes {include} of {target}, which is above it")
            elif name != "libslicecorr" and include in private:
                if not include.startswith(("support/", PROGRAMS)):
                    wrong.append(f"{place}: includes {include}, which is private to libslicecorr")
        if "include" in path.parts:
            for match in re.finditer(r"^(?:class|struct) (\w+)[^;{]*\{", text, re.M):
                declared.setdefault(match.group(1), (module, place))
            # Functions of the namespace: a line that begins in the first column and has a name before "(".
            for match in re.finditer(r"^(?!class|struct|using|template|namespace|#|/|\}|inline|constexpr|enum|extern)"
                                     r"[A-Za-z_][\w:<>,&\* ]*?[ &\*](\w+)\(", without_comments(text), re.M):
                declared.setdefault(match.group(1), (module, place))
    for path in sources(name):
        if path.suffix != ".cpp":
            continue
        module = module_of(name, path, homes, modules)
        text = without_comments(path.read_text())
        outside = re.sub(r"namespace \{\n.*?\n\}  // namespace\n", "", path.read_text(), flags=re.S)
        text = without_comments(re.sub(r"\nnamespace \{\n.*?\n\}(?=\s*//\s*namespace\s*\n|\s*\n)", "\n", outside, flags=re.S))
        for match in re.finditer(r"^(?!class|struct|using|template|#|\}|static|return)[A-Za-z_][\w:<>,&\* ]*?[ &\*]"
                                 r"(?:(\w+)::)*(\w+)\([^;{]*?\)[^;{}]*\{", text, re.M):
            owner = match.group(1) or match.group(2)
            if owner in declared and declared[owner][0] not in (None, module) and module not in ("c_api",):
                if match.group(1) is None and not re.search(r"\b" + re.escape(str(declared[owner][1].name)), path.read_text()):
                    continue  # another function of that name
                wrong.append(f"{path.relative_to(ROOT)}: module {module} defines {owner}, which "
                             f"{declared[owner][1]} of module {declared[owner][0]} declares")


def check_order_of_cmake(name, modules):
    text = (ROOT / name / "CMakeLists.txt").read_text()
    match = re.search(r"set\(modules ([^)]*)\)", text)
    listed = match.group(1).split()
    known = [m for m in modules if m in listed]
    if known != listed:
        wrong.append(f"{name}/CMakeLists.txt: modules are {listed}; cmake/layers.txt has {known}")


# Parsers of texts that others wrote, and the one file each that may call them: the others have bounds from it.
PARSERS = {r"\b(?:\w*[jJ]son|SortedJson)::(?:parse|accept|sax_parse|from_\w+)\(": "libslicecorr/support/json/read_json.cpp",
           r"\btoml::parse(?:_file)?\(": "libslicecorr/support/toml/toml_table.cpp",
           r"\bload_(?:buffer\w*|file|string)\(": "libslicecorr/stack/formats/read_xml.cpp"}


def check_parsers():
    for name in SPACES | {"slicer-plugin": ""}:
        for path in sources(name):
            place = str(path.relative_to(ROOT))
            text = without_comments(path.read_text())
            for pattern, home in PARSERS.items():
                for match in re.finditer(pattern, text):
                    if place != home:
                        wrong.append(f"{place}: calls {match.group(0)}...), which has no bounds; only {home} may")
            if re.search(r"\bstd::cin\s*>>\s*\w*[jJ]son|>>\s*json\b", text):
                wrong.append(f"{place}: reads JSON with >>, which has no bounds")


def main():
    components, below = read_layers()
    check_parsers()
    for name, modules in components.items():
        check_component(name, modules, below[name], components)
        check_order_of_cmake(name, modules)
    for line in wrong:
        print(line)
    print(f"{len(wrong)} wrong" if wrong else "layers: all includes go down")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
