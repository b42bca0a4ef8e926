"""Draws the figures of the guide: `python3 docs/figures.py` writes them to src/guide/."""

import random
from pathlib import Path

FOLDER = Path(__file__).resolve().parent.parent / "src" / "guide"
NEAR, FINE, MIDDLE, COARSE, OWN = "#d9480f", "#1c7ed6", "#37b24d", "#9c36b5", "#f08c00"


def svg(width, height, parts):
    """A drawing without an empty line, as HTML in a documentation comment needs it."""
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" fill="none"'
    return "\n".join([head + ' font-family="sans-serif" font-size="13">', *parts, "</svg>"]) + "\n"


def box(x, y, size, colour, opacity=0.35):
    return f'<rect x="{x}" y="{y}" width="{size}" height="{size}" fill="{colour}" fill-opacity="{opacity}" stroke="currentColor" stroke-opacity="0.5"/>'


def text(x, y, words, anchor="start"):
    return f'<text x="{x}" y="{y}" fill="currentColor" text-anchor="{anchor}">{words}</text>'


def arrow(x1, y1, x2, y2):
    return f'<line x1="{x1}" y1="{y1}" x2="{x2}" y2="{y2}" stroke="currentColor" stroke-width="1.5" marker-end="url(#tip)"/>'


TIP = '<defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7" orient="auto"><path d="M0 0L8 4L0 8z" fill="currentColor"/></marker></defs>'


def lists():
    """The cells that a target cell meets, level by level, in the plane."""
    levels, side, at = 4, 384, (5, 9)
    parts = []
    for level, colour in ((2, COARSE), (3, MIDDLE), (4, FINE)):
        size, shift = side >> level, levels - level
        target = (at[0] >> shift, at[1] >> shift)
        for i in range(2**level):
            for j in range(2**level):
                distance = max(abs(i - target[0]), abs(j - target[1]))
                parents = max(abs((i >> 1) - (target[0] >> 1)), abs((j >> 1) - (target[1] >> 1)))
                if distance > 1 and parents <= 1:
                    parts.append(box(i * size, j * size, size, colour))
                elif level == levels and distance <= 1:
                    parts.append(box(i * size, j * size, size, OWN if distance == 0 else NEAR, 0.9 if distance == 0 else 0.35))
    random.seed(1)
    for _ in range(300):
        x, y = random.random() * side, random.random() * side
        parts.append(f'<circle cx="{x:.0f}" cy="{y:.0f}" r="1.2" fill="currentColor"/>')
    legend = [
        (OWN, "the target cell"),
        (NEAR, "its neighbours: pair by pair"),
        (FINE, "well separated: M2L of its own level"),
        (MIDDLE, "M2L of its parent"),
        (COARSE, "M2L of its grandparent"),
    ]
    for k, (colour, words) in enumerate(legend):
        parts += [box(side + 20, 20 + 30 * k, 16, colour, 0.6), text(side + 44, 33 + 30 * k, words)]
    return svg(side + 290, side + 1, parts)


def passes():
    """The way from charges to values, through two trees."""
    parts = [TIP]
    heights = (40, 130, 220)
    centre = lambda left, level, k: left + (k - (2**level - 1) / 2) * 160 / 2**level
    for left, label, colour in ((110, "multipoles", FINE), (450, "locals", MIDDLE)):
        parts.append(text(left, 20, label, "middle"))
        for level, y in enumerate(heights):
            for k in range(2**level):
                x = centre(left, level, k)
                parts.append(box(x - 14, y, 28, colour))
                if level > 0:
                    ends = [(x, y - 4), (centre(left, level - 1, k // 2), heights[level - 1] + 32)]
                    up = label == "multipoles"
                    parts.append(arrow(*ends[0], *ends[1]) if up else arrow(*ends[1], *ends[0]))
    parts += [text(10, 105, "M2M"), text(10, 195, "M2M"), text(520, 105, "L2L"), text(520, 195, "L2L")]
    for y in heights:
        parts += [arrow(215, y + 14, 345, y + 14), text(280, y + 8, "M2L", "middle")]
    parts += [arrow(50, 300, 50, 252), text(60, 282, "P2M"), arrow(510, 252, 510, 300), text(520, 282, "L2P")]
    parts += [text(110, 320, "charges at the sources", "middle"), text(450, 320, "values at the targets", "middle")]
    parts += [arrow(200, 315, 365, 315), text(280, 308, "near pairs", "middle")]
    return svg(560, 330, parts)


if __name__ == "__main__":
    for name, draw in (("lists", lists), ("passes", passes)):
        (FOLDER / f"{name}.svg").write_text(draw())
