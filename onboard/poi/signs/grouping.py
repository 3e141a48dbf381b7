"""Which boxes of text stand on one row, and which rows are one sign; in the text's own direction. Pure."""

from __future__ import annotations

from collections.abc import Sequence

from onboard.poi.signs.text_line import TextLine, common_angle_rad

SAME_ROW = 0.5  # overlap across the text, share of the lower letters
ROW_GAP = 4.0  # between parts of one row, in heights of their letters
NEIGHBOUR_GAP = 1.9  # between lines of one sign, in heights of the higher letters
ASKEW_RAD = 0.35  # lines of one sign run in one direction

Row = list[TextLine]  # from left to right


def signs(lines: Sequence[TextLine]) -> list[list[TextLine]]:
    """Lines that stand together, above, below or beside one another, sign by sign; each from top to bottom."""
    groups: list[list[TextLine]] = []
    for line in lines:
        near = [g for g in groups if any(_neighbours(line, other) for other in g)]
        merged = [line, *(other for g in near for other in g)]
        groups = [g for g in groups if g not in near] + [merged]
    return [sorted(group, key=lambda line: line.middle[1]) for group in groups]


def rows_of(lines: Sequence[TextLine]) -> list[Row]:
    """The rows of a sign from top to bottom, turned level."""
    angle_rad = common_angle_rad(lines)
    rows: list[Row] = []
    for line in sorted((line.turned(angle_rad) for line in lines), key=lambda line: line.x_px):
        row = next((row for row in rows if _same_row(row[-1], line)), None)
        if row is None:
            rows.append([line])
        else:
            row.append(line)
    return sorted(rows, key=lambda row: row[0].middle[1])


def _same_row(a: TextLine, b: TextLine) -> bool:
    lower, higher = sorted((a.letter_px, b.letter_px))
    overlap = (a.letter_px + b.letter_px) / 2 - abs(a.middle[1] - b.middle[1])
    return overlap > SAME_ROW * lower and b.x_px - a.right_px < ROW_GAP * higher


def _neighbours(a: TextLine, b: TextLine) -> bool:
    # Steep text beside level text is another sign
    if abs(a.angle_rad - b.angle_rad) > ASKEW_RAD:
        return False
    angle_rad = common_angle_rad((a, b))
    a, b = a.turned(angle_rad), b.turned(angle_rad)
    reach = NEIGHBOUR_GAP * max(a.letter_px, b.letter_px)
    gap_y = abs(a.middle[1] - b.middle[1]) - (a.letter_px + b.letter_px) / 2
    gap_x = max(a.x_px, b.x_px) - min(a.right_px, b.right_px)
    # Rows of one sign may stand further apart than words of two
    return gap_y < reach and gap_x < reach
