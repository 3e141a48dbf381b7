#!/usr/bin/env bash
# rsvg-convert 2.54 (Debian 12, the newest there): --dpi-x and --dpi-y are lost in PNG and multiply the size in SVG.
#
# Expected: a drawing of 100 mm is 100 mm in every format; the resolution is that of pixels.
# Seen: at 300 dpi the PDF is 100 mm wide. The PNG has 1182 pixels for it and no resolution in the file, so that who
# prints it takes 72 or 96 dpi: 417 or 313 mm. The SVG has width="1181.1", which is px: 312.5 mm.
# Means: of three conversions of one plan at 1:100 one can be measured. Go through PDF, or write pHYs afterwards.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
for package in librsvg2-bin poppler-utils; do
  dpkg -s "$package" >/dev/null 2>&1 || { apt-get update -qq && apt-get install -y -qq "$package"; }
done
cd "$dir"
echo '<svg xmlns="http://www.w3.org/2000/svg" width="100mm" height="50mm" viewBox="0 0 100 50"></svg>' >plan.svg
for format in pdf png svg; do rsvg-convert -d 300 -p 300 -f "$format" plan.svg -o "out.$format"; done
rsvg-convert --version
python3 - <<'EOF'
import re
import subprocess

pdf = re.search(r"Page size: +([\d.]+)", subprocess.run(["pdfinfo", "out.pdf"], capture_output=True, text=True).stdout)
png = open("out.png", "rb").read()
svg = re.search(r'width="([\d.]+)"', open("out.svg").read())
size_mm = round(float(svg[1]) / 96 * 25.4)
seen = round(float(pdf[1]) / 72 * 25.4), int.from_bytes(png[16:20], "big"), b"pHYs" in png, size_mm
print(f"PDF {seen[0]} mm; PNG {seen[1]} pixels, with a resolution: {seen[2]}; SVG {seen[3]} mm")
assert seen == (100, 1182, False, 312), "changed"
EOF
