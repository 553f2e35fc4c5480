# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Many sources are compiled as one, so what is in an unnamed namespace is seen by its neighbours.

A function of the same name elsewhere in the library, or in a header, would be overloaded with it: a
call might reach another function than its author meant, without a word of the compiler. A constant
of the same name compiles or not by which sources are one that day.
Two types of one name in headers of a library are undefined behaviour, which no tool tells.
"""

import re
import sys
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
# A library sees the headers of those before it.
LIBRARIES = ["core", "io", "io/draw", "tools/run", "tools/serve", "tools/app", "tools/python"]
UNNAMED = re.compile(r"^namespace \{\n(.*?)^\}  // namespace$", re.M | re.S)
FUNCTION = re.compile(r"^(?!using|return|static_assert|namespace|#)[\w:][\w:<>,&*\s\[\]]*?[\s&*](\w+)\(", re.M)
CONSTANT = re.compile(r"^(?:inline )?const(?:expr)? [^=({;]*?\b(k[A-Z]\w*)(?:\[\w*\])? ?[={]", re.M)
TYPE = re.compile(r"^(?:struct|class|enum class) (\w+)(?: final)?(?: :[^:].*)? \{", re.M)


def types(text: str) -> set[str]:
    return set(TYPE.findall(text))


def names(text: str) -> set[str]:
    code = re.sub(r'//.*|"(?:\\.|[^"\\\n])*"', "", text)
    return {f"{name}()" for name in FUNCTION.findall(code)} | set(CONSTANT.findall(code))


def library_of(name: str) -> int:
    return max(i for i, each in enumerate(LIBRARIES) if name.startswith(each + "/"))


def main() -> int:
    places: dict[tuple[int, str], list[str]] = defaultdict(list)
    headers: dict[str, list[str]] = defaultdict(list)
    kinds: dict[tuple[int, str], list[str]] = defaultdict(list)
    for path in sorted(each for top in ("core", "io", "tools") for each in (ROOT / top).rglob("*.[ch]*")):
        name = str(path.relative_to(ROOT))
        if path.suffix == ".h":
            text = path.read_text()
            for each in names(text):
                headers[each].append(name)
            for each in types(text):
                kinds[library_of(name), each].append(name)
        elif path.suffix == ".cc":
            bodies = UNNAMED.findall(path.read_text())
            for each in set().union(*map(names, bodies)):
                places[library_of(name), each].append(name)
            for each in set().union(*map(types, bodies)):
                kinds[library_of(name), each].append(name)
    for (library, name), files in places.items():
        files += [each for each in headers[name] if library_of(each) <= library]
    faults = 0
    for (_, name), files in sorted(places.items()) + sorted(kinds.items()):
        if len(files) > 1:
            print(f"{name} is in {' and '.join(files)}: give one of them another name")
            faults += 1
    if not places:
        print("nothing in an unnamed namespace was found")
    return 1 if faults or not places else 0


if __name__ == "__main__":
    sys.exit(main())
