#!/usr/bin/env bash
# eclipse-zenoh 1.10.2 (PyPI, the newest): a router whose link is back within a tenth of a second of the loss, while
# another link of its neighbour had changed just before, is never told of that neighbour's subscribers again.
#
# Expected: once a link between two routers stands again, what is published on one side reaches the other, as before.
# Seen: after the link of B alone was cut and came back, A receives what B publishes. After the link of C was cut and,
# 30 ms later, that of B, both links come back, `info.links()` shows them, and A receives nothing from B any more; nor
# does it later, until the link of B is cut once more. No error, no warning. A computes its trees of routes at most
# every 100 ms and declares its subscribers (queryables, liveliness tokens) to neighbours that are new in them: one
# that went and came between two computations is not new.
# Means: on a shared radio all links break and return together, and then some stay deaf in one direction for good.
# Peers of a region of their own (`region_name`, `gateway.south`) are told everything whenever they connect.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
python3 -m venv "$dir/venv"
"$dir/venv/bin/pip" install -q 'eclipse-zenoh==1.10.2'
"$dir/venv/bin/python" - <<'EOF'
import json
import socket
import threading
import time

import zenoh


class Cable:
    """A TCP connection to a port, which can be cut; whoever connects again is connected again."""

    def __init__(self, port):
        self.port, self.ends = port, []
        self.server = socket.create_server(("127.0.0.1", 0))
        self.endpoint = f"tcp/127.0.0.1:{self.server.getsockname()[1]}"
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self):
        while True:
            near, _ = self.server.accept()
            far = socket.create_connection(("127.0.0.1", self.port))
            self.ends = [near, far]
            for source, sink in ((near, far), (far, near)):
                threading.Thread(target=self._carry, args=(source, sink), daemon=True).start()

    @staticmethod
    def _carry(source, sink):
        try:
            while data := source.recv(65536):
                sink.sendall(data)
        except OSError:
            pass
        for end in (source, sink):
            try:
                end.shutdown(socket.SHUT_RDWR)
            except OSError:
                pass

    def cut(self):
        for end in self.ends:
            end.shutdown(socket.SHUT_RDWR)


def router(listen=(), connect=()):
    config = zenoh.Config()
    config.insert_json5("mode", '"router"')
    config.insert_json5("listen/endpoints", json.dumps(list(listen)))
    config.insert_json5("connect/endpoints", json.dumps(list(connect)))
    config.insert_json5("scouting/multicast/enabled", "false")
    return zenoh.open(config)


with socket.create_server(("127.0.0.1", 0)) as probe:
    port = probe.getsockname()[1]
received = []
with router(listen=[f"tcp/127.0.0.1:{port}"]) as a:
    subscriber = a.declare_subscriber("data", lambda sample: received.append(sample.payload.to_string()))
    to_b, to_c = Cable(port), Cable(port)
    with router(connect=[to_b.endpoint]) as b, router(connect=[to_c.endpoint]):

        def arrives():
            """Whether A receives what B publishes, within five seconds."""
            received.clear()
            for _ in range(50):
                b.put("data", "x")
                time.sleep(0.1)
            return len(received) > 0

        def links():
            return len(a.info.links())

        time.sleep(2)
        seen = [(arrives(), links())]
        to_b.cut()
        time.sleep(2)
        seen.append((arrives(), links()))
        to_c.cut()
        time.sleep(0.03)
        to_b.cut()
        time.sleep(5)
        seen.append((arrives(), links()))
        to_b.cut()
        time.sleep(2)
        seen.append((arrives(), links()))
    subscriber.undeclare()
for what, (reached, count) in zip(("at first", "B was cut", "C and B were cut", "B was cut again"), seen):
    print(f"{what}: {count} links, what B publishes {'reaches' if reached else 'does not reach'} A")
assert seen == [(True, 2), (True, 2), (False, 2), (True, 2)], "changed"
EOF
