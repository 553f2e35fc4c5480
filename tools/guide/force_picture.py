# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Draws force.svg of the guide: the wedge before a blade, and digs of the example force_dig.py.

    PYTHONPATH=build/python python3 tools/guide/force_picture.py > tools/guide/force.svg
"""

import csv
import math
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

EXAMPLE = Path(__file__).parents[1] / "python/examples/force_dig.py"
INK, SOIL, DARK, RED, BLUE, GREY = "#222", "#eadbbd", "#d3b380", "#b8321f", "#1a5fa0", "#666"
WIDTH, HEIGHT = 1180, 480

# The soil of the wedge, and its blade.
RAKE, DELTA, PHI = np.radians([60, 20, 30])
GAMMA, COHESION, ADHESION, DEPTH_M = 18e3, 6e3, 3e3, 0.4


def polyline(points, colour, width=1.5, dash=""):
    at = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    dashes = f' stroke-dasharray="{dash}"' if dash else ""
    return f'<polyline points="{at}" fill="none" stroke="{colour}" stroke-width="{width}"{dashes}/>'


def area(points, colour):
    return f'<polygon points="{" ".join(f"{x:.1f},{y:.1f}" for x, y in points)}" fill="{colour}"/>'


def text(at, words, colour=INK, anchor="middle", size=14, turn=0.0):
    """Words with `_` before a subscript; their middle is at this height."""
    lower = rf'<tspan dy="4" font-size="{size - 4}">\1</tspan><tspan dy="-4">\2</tspan>'
    words = re.sub("_(.)([^_]*)", lower, str(words))
    turned = f' transform="rotate({turn:.1f} {at[0]:.1f} {at[1]:.1f})"' if turn else ""
    return (f'<text x="{at[0]:.1f}" y="{at[1]:.1f}" dy="0.35em" fill="{colour}" text-anchor="{anchor}" '
            f'font-size="{size}"{turned}>{words}</text>')


def arrow(a, b, colour, width=2.5, both=False):
    head = f"url(#h{colour[1:]})"
    start = f' marker-start="{head}"' if both else ""
    return (f'<line x1="{a[0]:.1f}" y1="{a[1]:.1f}" x2="{b[0]:.1f}" y2="{b[1]:.1f}" stroke="{colour}" '
            f'stroke-width="{width}" marker-end="{head}"{start}/>')


def arc(centre, radius, begin, end, colour=INK):
    """From an angle to another, rad from the way ahead upwards."""
    angles = np.linspace(begin, end, 24)
    return polyline([(centre[0] + radius * math.cos(a), centre[1] - radius * math.sin(a)) for a in angles],
                    colour, 1.2)


def least_wedge():
    """The failure angle of the least force, and the forces, N per metre of width."""
    best = None
    for beta in np.linspace(0.1, math.pi - RAKE - DELTA - PHI - 0.01, 20001):
        plane, blade = DEPTH_M / math.sin(beta), DEPTH_M / math.sin(RAKE)
        weight = GAMMA * DEPTH_M**2 / 2 * (1 / math.tan(RAKE) + 1 / math.tan(beta))
        force = (weight * math.sin(beta + PHI) + COHESION * plane * math.cos(PHI)
                 - ADHESION * blade * math.cos(RAKE + beta + PHI)) / math.sin(RAKE + beta + DELTA + PHI)
        if best is None or force < best[1]:
            best = beta, force, weight, plane, blade
    return best


def wedge():
    """All forces on the wedge to one scale; they are in equilibrium, or this stops."""
    beta, force, weight, plane, blade = least_wedge()
    m, kn = 450, 17  # pixels of 1 m, of 1 kN
    at_lip = np.array([262.0, 330.0])

    def ray(angle):  # in the picture, where y is down
        return np.array([math.cos(angle), -math.sin(angle)])

    up_blade, up_plane = ray(math.pi - RAKE), ray(beta)
    top, out = at_lip + m * blade * up_blade, at_lip + m * plane * up_plane
    of_p = math.pi / 2 - RAKE - DELTA        # P, from the way ahead
    of_r = math.pi / 2 + beta + PHI          # the reaction on the failure plane
    cohesion, adhesion = COHESION * plane, ADHESION * blade
    given = (force * ray(of_p) + cohesion * -up_plane + adhesion * -up_blade + weight * ray(-math.pi / 2))
    reaction = float(np.linalg.norm(given))
    assert np.linalg.norm(given + reaction * ray(of_r)) < 1e-3 * force, "the forces balance"
    left, right, ground, floor = 14, 640, top[1], at_lip[1]
    parts = [area([(left, floor), at_lip, out, (right, ground), (right, 400), (left, 400)], SOIL),
             area([at_lip, out, top], DARK),
             polyline([top, (right, ground)], INK, 1.5), polyline([(left, floor), at_lip], INK, 1.5),
             polyline([at_lip, (right, floor)], GREY, 1, "5 4"),
             polyline([at_lip, out], RED, 2, "8 5"),
             polyline([at_lip, top + 70 * up_blade], INK, 6)]

    # The blade's force, tilted by the tool's friction from the blade's normal.
    at_p = at_lip + 0.43 * m * blade * up_blade
    normal_p = at_p - 112 * ray(math.pi / 2 - RAKE)
    tail_p = at_p - kn * force / 1000 * ray(of_p)
    parts += [polyline([at_p - 18 * ray(math.pi / 2 - RAKE), normal_p], GREY, 1.2, "5 4"),
              arrow(tail_p, at_p - 3 * ray(of_p), BLUE, 3),
              arc(at_p, 100, math.pi + of_p, math.pi + math.pi / 2 - RAKE, BLUE),
              text(at_p - 115 * ray(of_p + DELTA / 2), "δ", BLUE, size=17),
              text(tail_p + (4, -16), "P", BLUE, "start", 19),
              text(normal_p + (-6, 3), "normal", GREY, "end", 13)]
    # Adhesion along the blade, cohesion along the failure plane: both against the way the soil slides.
    inside = ray(math.pi / 2 - RAKE)
    at_a = at_lip + 0.72 * m * blade * up_blade + 11 * inside
    half = kn * adhesion / 2000 * up_blade
    parts += [arrow(at_a + half, at_a - half, BLUE),
              text(at_a + 12 * inside + (4, 0), "c_a B", BLUE, "start", 16)]
    above = ray(beta + math.pi / 2)
    at_c = at_lip + 0.75 * m * plane * up_plane + 11 * above
    half = kn * cohesion / 2000 * up_plane
    parts += [arrow(at_c + half, at_c - half, RED), text(at_c + 14 * above + (-4, 0), "c L", RED, "end", 16)]
    # The reaction of the ground below, tilted by the soil's friction from the plane's normal.
    at_r = at_lip + 0.42 * m * plane * up_plane
    normal_r = at_r - 100 * above
    tail_r = at_r - kn * reaction / 1000 * ray(of_r)
    parts += [polyline([at_r - 18 * above, normal_r], GREY, 1.2, "5 4"),
              arrow(tail_r, at_r - 2 * ray(of_r), RED, 3),
              arc(at_r, 70, math.pi + of_r - PHI, math.pi + of_r, RED),
              text(at_r - 84 * ray(of_r - PHI / 2), "φ", RED, size=17),
              text(tail_r + (8, 4), "R", RED, "start", 19),
              text(normal_r + (8, 4), "normal", GREY, "start", 13)]
    # The weight at the wedge's centroid.
    middle = (at_lip + top + out) / 3
    parts += [arrow(middle, middle + (0, kn * weight / 1000), INK, 3),
              f'<circle cx="{middle[0]:.1f}" cy="{middle[1]:.1f}" r="3.5" fill="{INK}"/>',
              text(middle + (10, 16), "W = γ A", INK, "start", 16)]
    # Angles and lengths.
    parts += [arc(at_lip, 46, math.pi - RAKE, math.pi),
              text(at_lip + 62 * ray(math.pi - RAKE / 2), "α", size=17),
              arc(at_lip, 62, 0, beta), text(at_lip + 78 * ray(beta / 2), "β", size=17),
              text(at_lip + 0.73 * m * plane * up_plane - 17 * above, "failure plane, length L", RED, size=13,
                   turn=-math.degrees(beta)),
              text(at_lip + 0.77 * m * blade * up_blade - 15 * inside, "length B in soil", size=13,
                   turn=math.degrees(RAKE)),
              text(top + 62 * up_blade + (14, 0), "blade", anchor="start"),
              text((600, ground - 12), "ground", size=13),
              arrow((618, ground + 2), (618, floor - 2), INK, 1.2, both=True), text((604, 245), "d", size=16),
              text((at_lip[0] - 8, floor + 15), "lip", anchor="end", size=13),
              arrow((330, 92), (400, 92), GREY, 2), text((410, 92), "way ahead", GREY, "start"),
              text((left, 24), "Forces on the wedge of soil, per metre of width, to scale",
                   anchor="start", size=16),
              text((left, 425), f"P = {force / 1000:.1f} kN/m, W = {weight / 1000:.1f}, "
                   f"c L = {cohesion / 1000:.1f}, c_a B = {adhesion / 1000:.1f}, R = {reaction / 1000:.1f}, "
                   "with α = 60°, δ = 20°, φ = 30°, d = 0.4 m,", GREY, "start", 13),
              text((left, 444), "γ = 18 kN/m³, c = 6 kPa and c_a = 3 kPa; then P is least at "
                   f"β = {math.degrees(beta):.0f}°. The wedge slides up along", GREY, "start", 13),
              text((left, 463), "the blade and the failure plane. On the bucket, P and c_a B act the other way.",
                   GREY, "start", 13)]
    return parts


def digs():
    def rows(limit):
        with tempfile.NamedTemporaryFile(suffix=".csv") as file:
            subprocess.run([sys.executable, EXAMPLE, str(limit), file.name], check=True,
                           stdout=subprocess.DEVNULL)
            return np.array([list(map(float, row)) for row in list(csv.reader(open(file.name)))[1:]])

    free, limited = rows(100), rows(8)
    left, right = 730, 1160

    def at(x):
        return left + (x + 2.5) / 5 * (right - left)

    def height(z):
        return 165 - 150 * z

    def force(f):
        return 408 - f / 1000 * 9

    def axis(to_y, ticks, low, high, name):
        yield polyline([(left, to_y(low)), (left, to_y(high))], INK, 1)
        for tick in ticks:
            yield polyline([(left - 4, to_y(tick)), (right, to_y(tick))], "#ddd", 1)
        for tick, word in ticks.items():
            yield text((left - 8, to_y(tick)), word, GREY, "end", 12)
        yield text((left - 46, (to_y(low) + to_y(high)) / 2), name, INK, size=13, turn=-90)

    parts = list(axis(height, {-0.5: "−0.5", 0: "0", 0.5: "0.5"}, -0.5, 0.5, "height, m"))
    parts += axis(force, {1000 * k: k for k in (0, 5, 10, 15)}, 0, 16000, "force ahead, kN")
    x = np.linspace(-2.5, 2.5, 101)
    before = [(at(v), height(0.25 * math.exp(-2 * v * v))) for v in x]
    parts += [area([*before, (right, height(-0.5)), (left, height(-0.5))], SOIL), polyline(before, DARK, 1.5)]
    for dug, colour in ((free, BLUE), (limited, RED)):
        parts += [polyline([(at(r[0]), height(r[2])) for r in dug], colour, 2.2),
                  polyline([(at(r[0]), force(r[4])) for r in dug], colour, 1.6)]
    parts += [polyline([(left, force(8000)), (right, force(8000))], INK, 1.2, "6 5"),
              text((left + 8, force(8000) - 10), "limit of 8 kN", INK, "start", 12)]
    for k in range(6):
        parts.append(text((at(k - 2.5), force(0) + 14), k, GREY, size=12))
    parts.append(text(((left + right) / 2, force(0) + 34), "way of the lip, m", INK, size=13))
    parts.append(text((left - 54, 24), "The example's dig through a rise in the ground",
                      anchor="start", size=16))
    for (x0, y), colour, words in (((left + 150, 50), BLUE, "lip and force without a limit"),
                                   ((left + 150, 70), RED, "lip and force with a limit of 8 kN")):
        parts += [polyline([(x0, y), (x0 + 26, y)], colour, 2.5), text((x0 + 34, y), words, INK, "start", 13)]
    parts += [area([(left - 54, 44), (left - 28, 44), (left - 28, 56), (left - 54, 56)], SOIL),
              text((left - 20, 50), "ground before the dig", INK, "start", 13)]
    return parts


def main():
    heads = "".join(f'<marker id="h{c[1:]}" viewBox="0 0 10 8" refX="9" refY="4" markerUnits="userSpaceOnUse" '
                    f'markerWidth="13" markerHeight="10" orient="auto-start-reverse">'
                    f'<path d="M0,0L10,4L0,8z" fill="{c}"/></marker>' for c in (INK, RED, BLUE, GREY))
    body = "\n".join(wedge() + digs())
    print(f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" font-family="sans-serif">'
          f'<defs>{heads}</defs><rect width="{WIDTH}" height="{HEIGHT}" fill="#fff"/>\n{body}\n</svg>')


if __name__ == "__main__":
    main()
