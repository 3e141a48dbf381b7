#!/usr/bin/env bash
# PyMuPDF 2.0 (PyPI, the newest): a floor plan in SVG becomes a third too large when its size is given in px.
#
# Expected: in SVG 96 px are an inch, so width="377.95px", "100mm" and "283.46pt" are the same page.
# Seen: mm, cm, in, pc and pt are right; px, and numbers without a unit, are taken for points: 133.3 mm. Within one
# drawing a bar of 100mm and a bar of 377.95px differ.
# Means: plans at a scale (1:100) from programs that write px, which most do, come out of `convert_to_pdf` at 1:75, and
# nothing on the page tells. CairoSVG makes 100 mm of the same file (shown). Write mm, or scale by 0.75.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
dpkg -s libcairo2 >/dev/null 2>&1 || { apt-get update -qq && apt-get install -y -qq libcairo2; }
python3 -m venv "$dir/venv"
"$dir/venv/bin/pip" install -q 'pymupdf==2.0' 'cairosvg==2.9.1'
"$dir/venv/bin/python" - <<'EOF'
import cairosvg
import pymupdf

SIZES = ("100mm", "3.937in", "283.46pt", "377.95px", "377.95")


def width_mm(pdf):
    return round(pymupdf.open("pdf", pdf)[0].rect.width / 72 * 25.4, 1)


seen = {}
for size in SIZES:
    svg = f'<svg xmlns="http://www.w3.org/2000/svg" width="{size}" height="{size}" viewBox="0 0 1 1"></svg>'.encode()
    seen[size] = width_mm(pymupdf.open("svg", svg).convert_to_pdf()), width_mm(cairosvg.svg2pdf(svg))
    print(f"{size}: PyMuPDF {seen[size][0]} mm, CairoSVG {seen[size][1]} mm")
assert [first for first, _ in seen.values()] == [100, 100, 100, 133.3, 133.3], "changed"
assert {second for _, second in seen.values()} == {100}, "changed"
EOF
