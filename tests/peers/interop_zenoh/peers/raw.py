"""Hand-written node like those of rmw_zenoh_cpp, on Zenoh of that time: tokens, keys, attachments, CDR.

It imports nothing of this package; the formats and CONFIG are those of rmw_zenoh_cpp 0.2.10. Arguments: router, domain,
hash of std_srvs/srv/SetBool; then a lease in ms, or "silent" for a server that never answers. It prints lines:

    ready GID | heard DATA NUMBER GID | asked VALUE | answered SUCCESS TEXT | answered nothing | latched DATA
    token TEXT
"""

import json
import struct
import sys
import threading
import time

import xxhash
import zenoh
import zenoh.ext
from zenoh.handlers import Callback

ROUTER, DOMAIN, SERVICE_HASH = sys.argv[1:4]
LEASE_MS = int(sys.argv[4]) if sys.argv[4:5] and sys.argv[4].isdigit() else 60000
STRATEGY = {"peer": {"to_router": "always", "to_peer": "greater-zid"}}
CONFIG = {
    "mode": "peer",
    "connect": {"timeout_ms": {"router": -1, "peer": -1, "client": 0}, "endpoints": [ROUTER]},
    "listen": {"timeout_ms": 0, "endpoints": ["tcp/127.0.0.1:0"], "exit_on_failure": True},
    "scouting": {
        "timeout": 3000,
        "delay": 500,
        "multicast": {"enabled": False, "autoconnect_strategy": STRATEGY},
        "gossip": {
            "enabled": True,
            "multihop": False,
            "target": {"router": ["router", "peer"], "peer": ["router"]},
            "autoconnect": {"router": [], "peer": ["router", "peer"]},
            "autoconnect_strategy": STRATEGY,
        },
    },
    "timestamping": {"enabled": {"router": True, "peer": True, "client": True}},
    "queries_default_timeout": 600000,
    "routing": {"router": {"peers_failover_brokering": True}, "peer": {"mode": "peer_to_peer"}},
    "transport": {
        "unicast": {"open_timeout": 60000, "accept_timeout": 60000, "accept_pending": 10000, "max_sessions": 10000},
        "link": {"tx": {"lease": LEASE_MS, "keep_alive": 2}},
        "shared_memory": {"enabled": False},
    },
    "adminspace": {"enabled": True},
}
STRING = "std_msgs::msg::dds_::String_/RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
SET_BOOL = f"std_srvs::srv::dds_::SetBool_/{SERVICE_HASH}"
PLAIN, LATCHED, DEFAULT_SERVICE = "::,10:,:,:,,", ":1:,5:,:,:,,", "::,10:,:,:,,"

session = zenoh.open(zenoh.Config.from_json5(json.dumps(CONFIG)))
SILENT = "silent" in sys.argv
lock, kept, ids = threading.Lock(), [], iter(range(1, 100))


def say(*words: object) -> None:
    with lock:
        print(*words, flush=True)


def declare(kind: str, name: str, type_and_hash: str, qos: str) -> bytes:
    """Declare the token of an endpoint; return its GID."""
    start = f"@ros2_lv/{DOMAIN}/{session.info.zid()}/0/{next(ids)}/{kind}/%/%/raw"
    token = f"{start}/{name.replace('/', '%')}/{type_and_hash}/{qos}"
    kept.append(session.liveliness().declare_token(token))
    return xxhash.xxh3_128_intdigest(token.encode()).to_bytes(16, "little")


def attachment(number: int, gid: bytes) -> bytes:
    return struct.pack("<qqB16s", number, time.time_ns(), 16, gid)


def string(text: str) -> bytes:
    raw = text.encode() + b"\0"
    return struct.pack("<I", len(raw)) + raw


def text_of(data: bytes, offset: int = 4) -> str:
    (size,) = struct.unpack_from("<I", data, offset)
    return data[offset + 4 : offset + 4 + size - 1].decode()


def on_sample(sample: zenoh.Sample) -> None:
    number, _, _, gid = struct.unpack("<qqB16s", sample.attachment.to_bytes())
    say("heard", text_of(sample.payload.to_bytes()), number, gid.hex())


def on_query(query: zenoh.Query) -> None:
    number, _, _, gid = struct.unpack("<qqB16s", query.attachment.to_bytes())
    value = query.payload.to_bytes()[4]
    say("asked", value)
    if SILENT:
        kept.append(query)
        return
    reply = b"\0\1\0\0" + struct.pack("<B3x", value) + string("raw")
    query.reply(str(query.key_expr), reply, attachment=attachment(number, gid))
    query.drop()


def key(name: str, type_and_hash: str) -> str:
    return f"{DOMAIN}{name}/{type_and_hash}"


# The node first, then each endpoint before its token.
kept.append(session.liveliness().declare_token(f"@ros2_lv/{DOMAIN}/{session.info.zid()}/0/0/NN/%/%/raw"))
publisher = zenoh.ext.declare_advanced_publisher(session, key("/from/peer", STRING))
gid = declare("MP", "/from/peer", STRING, PLAIN)
latched = zenoh.ext.declare_advanced_publisher(
    session,
    key("/latched/by_peer", STRING),
    cache=zenoh.ext.CacheConfig(max_samples=5),
    sample_miss_detection=zenoh.ext.MissDetectionConfig(sporadic_heartbeat=0.5),
    publisher_detection=True,
)
latched_gid = declare("MP", "/latched/by_peer", STRING, LATCHED)
for number in range(1, 9):
    latched.put(b"\0\1\0\0" + string(f"latched {number}"), attachment=attachment(number, latched_gid))
kept.append(
    zenoh.ext.declare_advanced_subscriber(session, key("/to/peer", STRING), Callback(on_sample, indirect=False))
)
declare("MS", "/to/peer", STRING, PLAIN)
kept.append(session.declare_queryable(key("/peer/set", SET_BOOL), Callback(on_query, indirect=False), complete=True))
declare("SS", "/peer/set", SET_BOOL, DEFAULT_SERVICE)
querier = session.declare_querier(
    key("/ours/set", SET_BOOL),
    target=zenoh.QueryTarget.ALL_COMPLETE,
    consolidation=zenoh.ConsolidationMode.NONE,
    timeout=10.0,
)
client_gid = declare("SC", "/ours/set", SET_BOOL, DEFAULT_SERVICE)


def call(number: int, value: int) -> None:
    answers = []

    def on_reply(reply: zenoh.Reply) -> None:
        if reply.ok is None:
            return
        data = reply.ok.payload.to_bytes()
        replied, _, _, to = struct.unpack("<qqB16s", reply.ok.attachment.to_bytes())
        assert (replied, to) == (number, client_gid)
        answers.append((data[4], text_of(data, 8)))

    def done() -> None:
        say("answered", *(answers[0] if answers else ("nothing",)))

    request = b"\0\1\0\0" + bytes([value])
    querier.get(
        Callback(on_reply, drop=done, indirect=False), payload=request, attachment=attachment(number, client_gid)
    )


def on_latched(sample: zenoh.Sample) -> None:
    say("latched", text_of(sample.payload.to_bytes()))


def publish_forever() -> None:
    number = 0
    while True:
        number += 1
        publisher.put(b"\0\1\0\0" + string(f"raw {number}"), attachment=attachment(number, gid))
        time.sleep(0.05)


def on_token(sample: zenoh.Sample) -> None:
    if sample.kind == zenoh.SampleKind.PUT:
        say("token", sample.key_expr)


threading.Thread(target=publish_forever, daemon=True).start()
say("ready", gid.hex())
for number, line in enumerate(sys.stdin, 1):
    match line.split():
        case ["call", value]:
            call(number, int(value))
        case ["latch"]:
            kept.append(
                zenoh.ext.declare_advanced_subscriber(
                    session,
                    key("/latched/by_us", STRING),
                    Callback(on_latched, indirect=False),
                    history=zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=5),
                    recovery=zenoh.ext.RecoveryConfig(heartbeat=True),
                    subscriber_detection=True,
                )
            )
            declare("MS", "/latched/by_us", STRING, LATCHED)
        case ["tokens"]:
            kept.append(
                session.liveliness().declare_subscriber(
                    f"@ros2_lv/{DOMAIN}/**", Callback(on_token, indirect=False), history=True
                )
            )
session.close()
