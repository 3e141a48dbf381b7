"""What is no message, and how it gets to everybody."""

from __future__ import annotations

import random
from collections.abc import Collection

import msgpack
import zenoh

from common import bundle
from common.codec import CODEC_VERSION, encode
from common.config import Config
from common.messages.health import Status
from common.messages.topics import TOPICS
from common.zenoh_channel import Channel, session_config


def junk() -> list[bytes]:
    """Random, cut off, of another version, nothing."""
    chance = random.Random(1)
    sound = encode(Status(1.0, "RUN", 0, 1, True, 1), 3, 77)
    return [chance.randbytes(300), sound[:-4], msgpack.packb([CODEC_VERSION + 1, 1, 78, {}]), b""]


def huge() -> list[bytes]:
    return [bytes(100_000_000)]


def throw(config: Config, payloads: list[bytes], keys: Collection[str]) -> None:
    """Each payload at each topic, once: by itself, or where its messages travel in bundles, as one and within one."""
    bundles = {topic.key: topic.bundle_key for topic in TOPICS if topic.bundle_key}
    patient = session_config(Channel("client", connect=(config.mesh.router,)))
    patient.insert_json5("transport/link/tx/queue/congestion_control/block/wait_before_close", "10000000")
    with zenoh.open(patient) as stranger:

        def put(key: str, payload: bytes) -> None:
            stranger.put(f"{config.robot.name}/{key}", payload, congestion_control=zenoh.CongestionControl.BLOCK)

        for payload in payloads:
            for bundle_key in {bundles[key] for key in keys if key in bundles}:
                put(bundle_key, payload)
            for key in keys:
                if key in bundles:
                    put(bundles[key], bundle.pack([(key, payload, True)]))
                else:
                    put(key, payload)
