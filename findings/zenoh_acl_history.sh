#!/usr/bin/env bash
# eclipse-zenoh 1.10.2 (PyPI, the newest): an access rule that allows everything on `**` still takes away the history
# of advanced subscribers, without a word.
#
# Expected: with `key_exprs: ["**"]` and every kind of message allowed, access control changes nothing.
# Seen: live samples pass, the publisher's cache is never reached: 0 of 10 old samples, no error, no warning in
# the log. Cache and recovery work below `<key>/@adv/...`, and a chunk that begins with @ is matched by no
# wildcard. With `**/@adv/**` listed beside `**` all ten arrive.
# Means: a late joiner lacks what it should have been given (maps, state), and lost samples are not recovered, only
# where access control is on. List both expressions.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
python3 -m venv "$dir/venv"
"$dir/venv/bin/pip" install -q 'eclipse-zenoh==1.10.2'
"$dir/venv/bin/python" - <<'EOF'
import json
import socket
import time

import zenoh
from zenoh.ext import CacheConfig, HistoryConfig, declare_advanced_publisher, declare_advanced_subscriber

MESSAGES = ["put", "delete", "declare_subscriber", "query", "reply", "declare_queryable",
            "liveliness_token", "liveliness_query", "declare_liveliness_subscriber"]


def peer(listen=(), connect=(), allowed=()):
    config = zenoh.Config()
    config.insert_json5("listen/endpoints", json.dumps(list(listen)))
    config.insert_json5("connect/endpoints", json.dumps(list(connect)))
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("timestamping/enabled", "true")
    if allowed:
        rule = {"id": "all", "permission": "allow", "flows": ["ingress", "egress"], "messages": MESSAGES,
                "key_exprs": list(allowed)}
        config.insert_json5("access_control", json.dumps({
            "enabled": True, "default_permission": "deny", "rules": [rule],
            "subjects": [{"id": "local", "interfaces": ["lo"]}],
            "policies": [{"rules": ["all"], "subjects": ["local"]}]}))
    return zenoh.open(config)


def received(allowed):
    """(old samples, live samples) out of (10, 1) that a late joiner gets."""
    with socket.create_server(("127.0.0.1", 0)) as probe:
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    samples = []
    with peer(listen=[endpoint], allowed=allowed) as robot:
        publisher = declare_advanced_publisher(robot, "robot/map", cache=CacheConfig(max_samples=50))
        for _ in range(10):
            publisher.put("old")
        with peer(connect=[endpoint]) as laptop:
            subscriber = declare_advanced_subscriber(
                laptop, "robot/map", lambda sample: samples.append(sample.payload.to_string()),
                history=HistoryConfig(max_samples=50))
            time.sleep(2)
            publisher.put("live")
            time.sleep(1)
            subscriber.undeclare()
        publisher.undeclare()
    return samples.count("old"), samples.count("live")


zenoh.init_log_from_env_or("warn")
seen = {keys: received(keys) for keys in ((), ("**",), ("**", "**/@adv/**"))}
for keys, (old, live) in seen.items():
    print(f"allowed {list(keys) or 'without access control'}: {old} of 10 old samples, {live} of 1 live")
assert list(seen.values()) == [(10, 1), (0, 1), (10, 1)], "changed"
EOF
