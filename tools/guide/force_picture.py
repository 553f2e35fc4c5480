# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Draws force.svg of the guide: the wedge before a blade, and digs of the example force_dig.py.

    PYTHONPATH=build/python python3 tools/guide/force_picture.py > tools/guide/force.svg
"""

import csv
import subprocess
import sys
import tempfile
from pathlib import Path

EXAMPLE = Path(__file__).parents[1] / "python/examples/force_dig.py"
INK, SOIL, DARK, RED, BLUE, GREY = "#222", "#d9c29a", "#b5935a", "#c0392b", "#1f6fb2", "#777"


def line(points, colour, width=2.0, dash=""):
    at = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    return (f'<polyline points="{at}" fill="none" stroke="{colour}" stroke-width="{width}"'
            + (f' stroke-dasharray="{dash}"' if dash else "") + "/>")


def area(points, colour):
    return f'<polygon points="{" ".join(f"{x:.1f},{y:.1f}" for x, y in points)}" fill="{colour}"/>'


def text(x, y, words, colour=INK, anchor="start", size=14):
    return f'<text x="{x}" y="{y}" fill="{colour}" text-anchor="{anchor}" font-size="{size}">{words}</text>'


def arrow(a, b, colour):
    return (f'<line x1="{a[0]}" y1="{a[1]}" x2="{b[0]}" y2="{b[1]}" stroke="{colour}" '
            f'stroke-width="2.5" marker-end="url(#{colour[1:]})"/>')


def wedge():
    """The slice: blade at a rake of 60 degrees, failure plane at 34."""
    lip, top, out = (140, 300), (54, 152), (359, 152)
    parts = [area([(20, 152), (440, 152), (440, 340), (20, 340)], SOIL), area([lip, out, top], DARK),
             area([(20, 150), (top[0], 150), lip, (lip[0], 340), (20, 340)], "#fff"),
             line([(top[0], 152), (440, 152)], INK, 1.5),
             line([lip, (28, 107)], INK, 5), line([lip, out], RED, 2, "7 5"),
             line([lip, (230, 300)], GREY, 1, "4 4"), line([lip, (60, 300)], GREY, 1, "4 4"),
             arrow((232, 175), (232, 235), INK), text(182, 205, "weight"),
             arrow((300, 210), (262, 235), RED), text(306, 214, "cohesion, friction", RED),
             arrow((60, 255), (98, 232), BLUE), text(14, 276, "force P", BLUE),
             text(186, 293, "β"), text(70, 293, "rake"), text(40, 96, "blade"),
             text(215, 268, "failure plane", RED, "start", 12), text(300, 142, "ground", INK)]
    return parts


def digs():
    def rows(limit):
        with tempfile.NamedTemporaryFile(suffix=".csv") as file:
            subprocess.run([sys.executable, EXAMPLE, str(limit), file.name], check=True,
                           stdout=subprocess.DEVNULL)
            return [list(map(float, row)) for row in list(csv.reader(open(file.name)))[1:]]

    free, limited = rows(100), rows(8)
    left, right = 540, 960

    def at(x):
        return left + (x + 2.5) / 5 * (right - left)

    def height(z):
        return 130 - 160 * z

    def force(f):
        return 330 - f / 1000 * 9

    parts = [line([(left, 330), (right, 330)], INK, 1), line([(left, 185), (left, 330)], INK, 1)]
    for kn in (0, 5, 10, 15):
        y = force(1000 * kn)
        parts += [line([(left - 4, y), (right, y)], "#ddd", 1), text(left - 8, y + 5, kn, GREY, "end", 12)]
    parts += [text(left - 34, 180, "kN", GREY, "start", 12),
              line([(at(x), height(z)) for x, z, *_ in free], DARK, 1.5),
              line([(at(r[0]), height(r[2])) for r in free], BLUE, 2),
              line([(at(r[0]), height(r[2])) for r in limited], RED, 2),
              line([(at(r[0]), force(r[4])) for r in free[10:]], BLUE, 1.5),
              line([(at(r[0]), force(r[4])) for r in limited[10:]], RED, 1.5),
              line([(left, force(8000)), (right, force(8000))], RED, 1, "6 5"),
              text(right, 30, "lip: no limit", BLUE, "end"), text(right, 48, "lip: limit of 8 kN", RED, "end"),
              text(right, 66, "ground ahead", DARK, "end"),
              text((left + right) / 2, 352, "way of the lip, 5 m", GREY, "middle", 12)]
    return parts


def main():
    heads = "".join(f'<marker id="{c[1:]}" viewBox="0 0 10 10" refX="8" refY="5" markerWidth="6" '
                    f'markerHeight="6" orient="auto"><path d="M0,0L10,5L0,10z" fill="{c}"/></marker>'
                    for c in (INK, RED, BLUE))
    body = "\n".join(wedge() + digs())
    print(f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 980 360" font-family="sans-serif">'
          f'<defs>{heads}</defs><rect width="980" height="360" fill="#fff"/>\n{body}\n</svg>')


if __name__ == "__main__":
    main()
