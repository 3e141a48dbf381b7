# Sourced by local.sh and test.sh: makes .venv with the pinned packages, once; sets ROOT and PYTHON.
# A stamp keeps what was installed; as long as it fits, this costs a few milliseconds.

ROOT="$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)"
PYTHON="$ROOT/.venv/bin/python"
DEBIAN_PACKAGES=(g++ libegl1 libopengl0 libgl1-mesa-dri)
# A browser for the page; the firmware's build for the Mega, and simavr to run it (`simulate --board avr`)
TEST_PACKAGES=(chromium make gcc-avr avr-libc arduino-core-avr arduino-builder libsimavr-dev libelf-dev)
TEST_PACKAGES+=(clang libclang-rt-dev)        # the fuzzer
TEST_PACKAGES+=(iproute2)                     # machines behind bad links
TEST_PACKAGES+=(openssh-server rsync sudo)    # boards to deploy to
TEST_PACKAGES+=(systemd-container mmdebstrap) # booted ones
TEST_PACKAGES+=(poppler-utils librsvg2-bin)   # readers of exported drawings
TEST_PACKAGES+=(systemd avrdude)              # the boards' units, and flashing the Mega

say() { printf '%s\n' "$*" >&2; }

# Installs Debian packages, or says the one line that does
need_debian() {
    local install=(apt-get install -y --no-install-recommends "$@") sudo=()
    if [ "$(id -u)" -ne 0 ]; then
        if ! command -v sudo >/dev/null || ! sudo -n true 2>/dev/null; then
            say "Please run this line, then start again: sudo apt-get update && sudo ${install[*]}"
            exit 2
        fi
        sudo=(sudo -n)
    fi
    say "Installing Debian packages: $*"
    "${sudo[@]}" apt-get update -qq >&2
    "${sudo[@]}" env DEBIAN_FRONTEND=noninteractive "${install[@]}" >&2
}

missing_debian() {
    local package
    for package in "$@"; do
        dpkg-query -W -f '${db:Status-Status}\n' "$package" 2>/dev/null | grep -qx installed || printf '%s\n' "$package"
    done
}

has_debian() { command -v dpkg-query >/dev/null && command -v apt-get >/dev/null; }

# What only tests need: they skip without it, so that being no root ends nothing
set_up_tests() {
    local missing
    has_debian || return 0
    mapfile -t missing < <(missing_debian "${TEST_PACKAGES[@]}")
    if [ "${#missing[@]}" -gt 0 ]; then
        (need_debian "${missing[@]}") || say "Going on; tests that need what is missing are skipped."
    fi
}

wanted_stamp() {
    { printf '%s\n' "$ROOT"; python3 -V; cat "$ROOT/pyproject.toml" "$ROOT/constraints.txt" "$ROOT/deploy/setup.sh"; } |
        sha256sum
}

set_up() {
    local stamp="$ROOT/.venv/stamp" wanted missing
    if ! python3 -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
        say "Python 3.11 or newer is needed: install it as python3, then start again."
        exit 2
    fi
    wanted="$(wanted_stamp)"
    if [ -f "$stamp" ] && [ "$(cat "$stamp")" = "$wanted" ]; then
        return
    fi
    if has_debian; then
        mapfile -t missing < <(missing_debian "${DEBIAN_PACKAGES[@]}")
        python3 -c 'import ensurepip, venv' 2>/dev/null || missing+=(python3-venv)
        if [ "${#missing[@]}" -gt 0 ]; then
            need_debian "${missing[@]}"
        fi
    fi
    say "Setting up $ROOT/.venv; this takes a minute or two, once."
    python3 -m venv --clear "$ROOT/.venv"
    "$PYTHON" -m pip install -q --disable-pip-version-check -c "$ROOT/constraints.txt" \
        -e "$ROOT[mapping,sim,vision,laptop,export,dev]" >&2
    printf '%s\n' "$wanted" >"$stamp"
}
