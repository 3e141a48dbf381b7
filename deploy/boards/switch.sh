# On a board: makes a release the running one, and returns to the last good one if it does not run.
# Usage: switch NAME SECONDS, with NAME - for the last good release but the one that runs; sent over ssh, hence without
# a file of its own there. Exit codes: 0 runs, 3 another release runs again, 4 nothing runs, 5 there is no such release.
#
# It goes on when the link breaks: whoever comes back finds one release or the other running.
set -u
trap '' HUP PIPE

HOME_DIR=/opt/indoor-mapping
UNITS=/etc/systemd/system
KEPT=3

units_of() { (cd "$HOME_DIR/releases/$1/units" 2>/dev/null && ls); }
services_of() { units_of "$1" | grep '\.service$'; }

# Good releases, the newest first
good() { (cd "$HOME_DIR/releases" && ls -t ./*/.ok 2>/dev/null) | sed 's|^\./||; s|/\.ok$||'; }

install_units() {
    local unit
    for unit in "$UNITS"/indoor-mapping*; do
        [ -e "$unit" ] || continue
        [ -e "$HOME_DIR/releases/$1/units/${unit##*/}" ] || { systemctl disable -q "${unit##*/}"; rm -f "$unit"; }
    done
    for unit in $(units_of "$1"); do
        cp "$HOME_DIR/releases/$1/units/$unit" "$UNITS/$unit" || return 1
    done
    systemctl daemon-reload
}

stop_all() {
    local unit services=""
    for unit in "$UNITS"/indoor-mapping*.service; do
        [ -e "$unit" ] && services="$services ${unit##*/}"
    done
    [ -z "$services" ] || systemctl stop indoor-mapping.target $services
    [ -z "$services" ] || systemctl reset-failed $services 2>/dev/null
}

# Every service runs, and none had to be restarted
healthy() {
    local service
    for service in $(services_of "$1"); do
        [ "$(systemctl show -p ActiveState --value "$service")" = active ] || { echo "$service does not run"; return 1; }
        [ "$(systemctl show -p NRestarts --value "$service")" = 0 ] || { echo "$service ended"; return 1; }
    done
}

run_release() {
    stop_all
    install_units "$1" || return 1
    ln -sfn "releases/$1" "$HOME_DIR/current.new" && mv -T "$HOME_DIR/current.new" "$HOME_DIR/current" || return 1
    sync -f "$HOME_DIR"
    systemctl enable -q indoor-mapping.target
    systemctl start indoor-mapping.target $(services_of "$1") || return 1
    sleep "$2"
    healthy "$1"
}

prune() {
    local name kept
    kept="$(good | head -n "$KEPT") $(basename "$(readlink "$HOME_DIR/current")")"
    for name in $(ls "$HOME_DIR/releases"); do
        case " $(echo $kept) " in *" $name "*) ;; *) rm -rf "$HOME_DIR/releases/$name" ;; esac
    done
}

main() {
    local name="$1" seconds="$2" before other
    exec 9>"$HOME_DIR/.lock" && flock 9
    before="$(basename "$(readlink "$HOME_DIR/current" 2>/dev/null)" 2>/dev/null)"
    [ "$name" != - ] || name="$(good | grep -vx "$before" | head -n 1)"
    [ -n "$name" ] && [ -d "$HOME_DIR/releases/$name" ] || { echo "there is no earlier release that ran well"; exit 5; }
    if run_release "$name" "$seconds"; then
        touch "$HOME_DIR/releases/$name/.ok"
        prune
        echo "$name"
        exit 0
    fi
    rm -f "$HOME_DIR/releases/$name/.ok"
    for other in $(good | grep -vx "$name"); do
        if run_release "$other" "$seconds"; then
            echo "returned to $other"
            exit 3
        fi
    done
    stop_all
    echo "no other release ran well, so nothing runs"
    exit 4
}
