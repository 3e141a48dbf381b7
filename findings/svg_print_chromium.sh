#!/usr/bin/env bash
# Chromium 156 (Debian 12, the newest there): an SVG file in millimetres is printed at another scale, and cut off.
#
# Expected: an SVG of width="480mm" height="490mm" printed to PDF is one page of that size, or at least shows 100 mm as
# 100 mm, as CairoSVG does.
# Seen: two pages of US Letter, everything at two thirds of its size, and the square at the lower right corner is on
# neither. Up to 1.5 times the paper's width a drawing is shrunk to fit, what is wider is cut; no message tells of it.
# Means: a plan of 1:100 becomes 1:150, and its right part is missing, though the file itself is right. An @page rule
# within the SVG's own style sheet cures both (also shown).
set -euo pipefail
command -v chromium >/dev/null || { apt-get update -qq && apt-get install -y -qq chromium; }
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
python3 -m venv "$dir/venv"
"$dir/venv/bin/pip" install -q 'pymupdf==2.0'
cd "$dir"
drawing='<rect width="100" height="10"/><rect x="460" y="470" width="20" height="20"/>'
size='xmlns="http://www.w3.org/2000/svg" width="480mm" height="490mm" viewBox="0 0 480 490"'
echo "<svg $size>$drawing</svg>" >plain.svg
echo "<svg $size><style>@page { size: 480mm 490mm; margin: 0 }</style>$drawing</svg>" >page.svg
for name in plain page; do
  HOME=$dir chromium --headless --no-sandbox --disable-gpu --no-pdf-header-footer \
    --print-to-pdf="$dir/$name.pdf" "file://$dir/$name.svg" >/dev/null 2>&1
done
venv/bin/python - <<'EOF'
import pymupdf

seen = {}
for name in ("plain", "page"):
    pages = list(pymupdf.open(f"{name}.pdf"))
    bars = [round(bar["rect"].width / 72 * 25.4) for page in pages for bar in page.get_drawings()]
    seen[name] = round(pages[0].rect.width / 72 * 25.4), round(pages[0].rect.height / 72 * 25.4), bars
    print(f"{name}.svg: page {seen[name][0]} x {seen[name][1]} mm, bars of 100 and 20 mm are {bars} mm wide")
assert seen == {"plain": (216, 279, [67]), "page": (480, 490, [100, 20])}, "changed"
EOF
