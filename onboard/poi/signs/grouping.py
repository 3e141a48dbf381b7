"""Which boxes of text are one line, and which lines are one sign. Pure."""

from __future__ import annotations

from collections.abc import Sequence

from onboard.poi.signs.text_line import TextLine

SAME_LINE = 0.5  # overlap along y, share of the smaller height
WORD_GAP = 1.0  # between boxes of one line, in heights
NEIGHBOUR_GAP = 1.6  # between lines of one sign, in heights of the higher one


def merged_lines(boxes: Sequence[TextLine]) -> list[TextLine]:
    """Boxes that stand side by side become one line, its words parted by spaces; from top to bottom."""
    lines: list[TextLine] = []
    for box in sorted(boxes, key=lambda b: b.x_px):
        for i, line in enumerate(lines):
            lower = min(line.height_px, box.height_px)
            overlap = min(line.bottom_px, box.bottom_px) - max(line.y_px, box.y_px)
            if overlap > SAME_LINE * lower and box.x_px - line.right_px < WORD_GAP * lower:
                top, bottom = min(line.y_px, box.y_px), max(line.bottom_px, box.bottom_px)
                lines[i] = TextLine(
                    f"{line.text} {box.text}",
                    min(line.confidence, box.confidence),
                    line.x_px,
                    top,
                    max(line.right_px, box.right_px) - line.x_px,
                    bottom - top,
                )
                break
        else:
            lines.append(box)
    return sorted(lines, key=lambda line: line.y_px)


def signs(lines: Sequence[TextLine]) -> list[list[TextLine]]:
    """Lines that stand together, above or below one another, sign by sign."""
    groups: list[list[TextLine]] = []
    for line in lines:
        near = [g for g in groups if any(_neighbours(line, other) for other in g)]
        merged = [line, *(other for g in near for other in g)]
        groups = [g for g in groups if g not in near] + [merged]
    return [sorted(group, key=lambda line: line.y_px) for group in groups]


def _neighbours(a: TextLine, b: TextLine) -> bool:
    gap_y = max(a.y_px, b.y_px) - min(a.bottom_px, b.bottom_px)
    gap_x = max(a.x_px, b.x_px) - min(a.right_px, b.right_px)
    reach = NEIGHBOUR_GAP * max(a.height_px, b.height_px)
    return gap_y < reach and gap_x < reach
