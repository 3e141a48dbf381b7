#!/usr/bin/env bash
# filterpy 2.0.0 (PyPI, the newest): `residual_resample` never draws particles of small weight, and others too often.
#
# Expected: residual resampling is unbiased: of N particles the one of weight w survives N * w times on average.
# Seen: weights .5 .25 .15 .06 .04 should give 2.5 1.25 0.75 0.3 0.2 copies and give 3.5 1.5 0 0 0. After the whole
# copies the remainder is taken as w - floor(N w) instead of N w - floor(N w): it is negative for the heavy ones, so
# that the cumulative sum falls and the search in it picks wrong ones. Reported upstream in 2023 and still so in the
# release of 2026; the documentation names no restriction.
# Means: a particle filter loses its minor hypotheses at once: in a building of alike corridors localisation commits
# to the first favourite. The module's other resamplers are right (systematic, stratified: also shown).
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
python3 -m venv "$dir/venv"
"$dir/venv/bin/pip" install -q 'numpy==2.4.6' 'scipy==1.17.1'
"$dir/venv/bin/pip" install -q --no-deps 'filterpy==2.0.0'
"$dir/venv/bin/python" - <<'EOF'
import numpy as np
from filterpy.monte_carlo import residual_resample, stratified_resample, systematic_resample

WEIGHTS = np.array([0.5, 0.25, 0.15, 0.06, 0.04])
ROUNDS = 4000
np.random.seed(1)


def copies(resample):
    return sum(np.bincount(resample(WEIGHTS), minlength=5) for _ in range(ROUNDS)) / ROUNDS


wanted = WEIGHTS * 5
print("wanted", wanted)
for resample in (systematic_resample, stratified_resample):
    print(resample.__name__, copies(resample))
    assert np.allclose(copies(resample), wanted, atol=0.05)
biased = copies(residual_resample)
print("residual_resample", biased)
assert np.allclose(biased, [3.5, 1.5, 0, 0, 0], atol=0.05), "changed"
EOF
