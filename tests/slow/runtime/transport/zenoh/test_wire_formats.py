"""Keys, attachments, and liveliness tokens with their QoS and GIDs: docs/internals/zenoh.md 2 to 4, 7 and 9."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rosidl_py_gen.runtime.transport import qos
from rosidl_py_gen.runtime.transport.qos import (
    DEFAULT,
    INFINITE_NS,
    MAX_DEPTH,
    Durability,
    History,
    InvalidQoSError,
    Liveliness,
    QoSProfile,
    Reliability,
)
from rosidl_py_gen.runtime.transport.zenoh.wire_formats import (
    CPU_BACKEND,
    AttachmentError,
    EndpointToken,
    EntityKind,
    NodeToken,
    data_key,
    gid_of,
    pack_attachment,
    qos_text,
    read_qos,
    read_token,
    unpack_attachment,
    valid_hash_or_empty,
)

HASH = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
STRING = "std_msgs::msg::dds_::String_"


# --------------------------------------------------------------------------------------------------------------- keys


@pytest.mark.parametrize(
    ("domain_id", "name", "type_name", "type_hash", "key"),
    [
        (0, "/chatter", STRING, HASH, f"0/chatter/{STRING}/{HASH}"),
        (0, "/robot1/chatter", STRING, HASH, f"0/robot1/chatter/{STRING}/{HASH}"),
        (232, "/chatter/", STRING, HASH, f"232/chatter/{STRING}/{HASH}"),
        (0, "chatter", STRING, HASH, f"0/chatter/{STRING}/{HASH}"),  # avoid_ros_namespace_conventions
        (7, "/chatter", STRING, "", f"7/chatter/{STRING}/TypeHashNotSupported"),
        (
            0,
            "/fibonacci/_action/send_goal",
            "example_interfaces::action::dds_::Fibonacci_SendGoal_",
            HASH,
            f"0/fibonacci/_action/send_goal/example_interfaces::action::dds_::Fibonacci_SendGoal_/{HASH}",
        ),
    ],
)
def test_data_key_is_made_of_domain_name_type_and_hash(
    domain_id: int, name: str, type_name: str, type_hash: str, key: str
) -> None:
    assert data_key(domain_id, name, type_name, type_hash) == key


@pytest.mark.parametrize(
    "chunk", ["", "TypeHashNotSupported", HASH[:-1], HASH + "0", HASH.upper(), HASH + "\n", HASH.replace("01_", "02_")]
)
def test_incomplete_type_hash_is_treated_as_missing(chunk: str) -> None:
    assert valid_hash_or_empty(HASH) == HASH
    assert valid_hash_or_empty(chunk) == ""


# -------------------------------------------------------------------------------------------------------- attachments

GID = bytes.fromhex("eb85fa883b7846dc448a4501890ad062")
BYTES = bytes.fromhex(
    "0100000000000000"  # sequence number 1
    "15cd5b0700000000"  # 123456789 ns
    "10"  # length of the GID, a varint
    "eb85fa883b7846dc448a4501890ad062"
)
NUMBERS = st.integers(0, 2**63 - 1)


def test_attachment_contains_sequence_number_time_and_gid() -> None:
    assert pack_attachment(1, 123456789, GID) == BYTES
    assert unpack_attachment(BYTES) == (1, 123456789, GID)


def test_zenoh_serializer_writes_the_same_attachment_bytes() -> None:
    ext = pytest.importorskip("zenoh.ext")
    assert bytes(ext.z_serialize((ext.Int64(1), ext.Int64(123456789), GID))) == BYTES


@given(NUMBERS, NUMBERS, st.binary(min_size=16, max_size=16))
def test_attachments_round_trip(sequence: int, stamp_ns: int, gid: bytes) -> None:
    assert unpack_attachment(pack_attachment(sequence, stamp_ns, gid)) == (sequence, stamp_ns, gid)


@given(st.binary(max_size=100))
def test_any_attachment_bytes_are_read_or_raise_attachment_error(data: bytes) -> None:
    try:
        sequence, stamp_ns, gid = unpack_attachment(data)
    except AttachmentError:
        return
    assert pack_attachment(sequence, stamp_ns, gid) == data


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "expected an attachment of 33 bytes, found 0 bytes"),
        (BYTES + b"\0", "expected an attachment of 33 bytes, found 34 bytes"),
        (bytes(77), "found 77 bytes; rmw_zenoh_cpp before Jazzy's 0.2.4"),
        (BYTES[:16] + b"\x0f" + GID, "byte 16: expected 16, the length of a GID, found 15"),
        (b"\xff" * 8 + BYTES[8:], "byte 0: expected a sequence number of 0 or more, found -1"),
        (BYTES[:8] + b"\xff" * 8 + BYTES[16:], "byte 8: expected a time of 0 or more, found -1"),
    ],
)
def test_attachment_error_names_the_wrong_byte(data: bytes, message: str) -> None:
    with pytest.raises(AttachmentError, match=re.escape(message)):
        unpack_attachment(data)


ZID = "8b20917502ee955ac4476e0266340d5c"
# The example of rmw_zenoh's docs/design.md.
TALKER = f"@ros2_lv/0/{ZID}/0/10/MP/%/%/talker/%chatter/{STRING}/{HASH}/::,7:,:,:,,"
NODE = NodeToken(0, ZID, 0, "talker")
WRITER = EndpointToken(NODE, 10, EntityKind.PUBLISHER, "/chatter", STRING, HASH, DEFAULT.keep_last(7))


# --------------------------------------------------------------------------------------------------------------- qos


def announced(profile: QoSProfile) -> QoSProfile:
    """Return the profile with the defaults of rmw_zenoh_cpp for undetermined values."""
    return replace(
        profile,
        history=profile.history or History.KEEP_LAST,
        depth=profile.depth or 42,
        reliability=profile.reliability or Reliability.RELIABLE,
        durability=profile.durability or Durability.VOLATILE,
        liveliness=profile.liveliness or Liveliness.AUTOMATIC,
        deadline_ns=profile.deadline_ns or INFINITE_NS,
        lifespan_ns=profile.lifespan_ns or INFINITE_NS,
        liveliness_lease_ns=profile.liveliness_lease_ns or INFINITE_NS,
    )


@pytest.mark.parametrize(
    ("profile", "text"),
    [
        (DEFAULT, "::,10:,:,:,,"),
        (qos.SERVICES_DEFAULT, "::,10:,:,:,,"),
        (qos.SENSOR_DATA, "2::,5:,:,:,,"),
        (qos.PARAMETERS, "::,1000:,:,:,,"),
        (qos.PARAMETER_EVENTS, "::,1000:,:,:,,"),
        (qos.ACTION_STATUS, ":1:,1:,:,:,,"),
        (qos.ROSOUT, ":1:,1000:,:10,0:,,"),
        (qos.CLOCK, "2::,1:,:,:,,"),
        (DEFAULT.keep_all(), "::2,:,:,:,,"),
        (DEFAULT.keep_last(42), "::,:,:,:,,"),
        (qos.SYSTEM_DEFAULT, "::,:,:,:,,"),
        (DEFAULT.deadline(0.5), "::,10:0,500000000:,:,,"),
        (DEFAULT.manual_liveliness(2), "::,10:,:,:3,2,0"),
        (qos.BEST_AVAILABLE, "4:4:,10:,854775806:,:5,,854775806"),
    ],
)
def test_default_values_are_omitted_from_qos_text(profile: QoSProfile, text: str) -> None:
    assert qos_text(profile) == text
    assert read_qos(text) == announced(profile)


@pytest.mark.parametrize(
    ("text", "profile"),
    [
        # Texts of other implementations: explicit defaults, and values that no profile can contain.
        ("1:2:1,42:9223372036,854775807:9223372036,854775807:1,9223372036,854775807", announced(DEFAULT.keep_last(42))),
        ("::,0:,:,:,,", announced(DEFAULT.keep_last(42))),
        ("::,18446744073709551615:,:,:,,", announced(DEFAULT.keep_last(MAX_DEPTH))),
        ("::,10:18446744073709551615,18446744073709551615:,:,,", announced(DEFAULT)),
        ("::,10:0,0:,:,,", replace(announced(DEFAULT), deadline_ns=0)),
        (
            "3:3:3,10:,:,:4,,",
            replace(
                announced(DEFAULT),
                reliability=Reliability.UNKNOWN,
                durability=Durability.UNKNOWN,
                history=History.UNKNOWN,
                liveliness=Liveliness.UNKNOWN,
            ),
        ),
        ("::,10:,:,:,,,later:later", announced(DEFAULT)),
    ],
)
def test_qos_text_of_other_implementations_is_read_like_rmw_zenoh(text: str, profile: QoSProfile) -> None:
    assert read_qos(text) == profile


@pytest.mark.parametrize(
    "text",
    [
        "",
        "::,10:,:,:,",
        ":,:10:,:,:,,",
        "5::,10:,:,:,,",
        ":5:,10:,:,:,,",
        "::4,10:,:,:,,",
        "::,10:,:,:2,,",  # MANUAL_BY_NODE: rmw_zenoh_cpp drops the token, too
        "::,-1:,:,:,,",
        "::,+1:,:,:,,",
        "::, 1:,:,:,,",
        "::,1_0:,:,:,,",
        "::,\u0661:,:,:,,",
        "::,\u00b2:,:,:,,",
        "::," + "9" * 5000 + ":,:,:,,",
    ],
)
def test_invalid_qos_text_returns_none(text: str) -> None:
    assert read_qos(text) is None


def test_unknown_qos_policy_cannot_be_announced() -> None:
    with pytest.raises(InvalidQoSError, match=r"Durability\.UNKNOWN cannot be announced"):
        qos_text(replace(DEFAULT, durability=Durability.UNKNOWN))


PERIODS = st.one_of(st.integers(0, INFINITE_NS), st.sampled_from([0, INFINITE_NS, INFINITE_NS - 1]))
PROFILES = st.builds(
    QoSProfile,
    st.sampled_from([one for one in History if one.name != "UNKNOWN"]),
    st.integers(0, MAX_DEPTH),
    st.sampled_from([one for one in Reliability if one.name != "UNKNOWN"]),
    st.sampled_from([one for one in Durability if one.name != "UNKNOWN"]),
    PERIODS,
    PERIODS,
    st.sampled_from([one for one in Liveliness if one.name != "UNKNOWN"]),
    PERIODS,
)


@given(PROFILES)
def test_qos_profiles_round_trip_through_text(profile: QoSProfile) -> None:
    text = qos_text(profile)
    assert read_qos(text) == announced(profile)
    assert qos_text(announced(profile)) == text


# ------------------------------------------------------------------------------------------------------------ tokens


@pytest.mark.parametrize(
    ("token", "text"),
    [
        (WRITER, TALKER),
        (NODE, f"@ros2_lv/0/{ZID}/0/0/NN/%/%/talker"),
        (NodeToken(5, "1a", 12, "arm", "/robot1/left", "/one/two"), "@ros2_lv/5/1a/12/12/NN/%one%two/%robot1%left/arm"),
        (
            EndpointToken(NODE, 1, EntityKind.SERVER, "/robot1/add", "p::srv::dds_::Add_", "", DEFAULT),
            f"@ros2_lv/0/{ZID}/0/1/SS/%/%/talker/%robot1%add/p::srv::dds_::Add_/TypeHashNotSupported/::,10:,:,:,,",
        ),
        (
            replace(WRITER, kind=EntityKind.SUBSCRIPTION, qos=qos.SENSOR_DATA, backends=CPU_BACKEND),
            f"@ros2_lv/0/{ZID}/0/10/MS/%/%/talker/%chatter/{STRING}/{HASH}/2::,5:,:,:,,/backends:cpu:",
        ),
        (
            EndpointToken(NODE, 2, EntityKind.CLIENT, "/fib/_action/get_result", "p::F_", HASH, DEFAULT),
            f"@ros2_lv/0/{ZID}/0/2/SC/%/%/talker/%fib%_action%get_result/p::F_/{HASH}/::,10:,:,:,,",
        ),
    ],
)
def test_liveliness_tokens_are_written_like_rmw_zenoh(token: NodeToken | EndpointToken, text: str) -> None:
    assert str(token) == text
    read = read_token(text)
    assert read is not None and str(read) == text


def test_additional_token_chunks_are_ignored() -> None:
    assert read_token(TALKER + "/backends:cpu:/later") == replace(
        WRITER, qos=announced(WRITER.qos), backends=CPU_BACKEND
    )
    assert read_token(f"@ros2_lv/0/{ZID}/0/0/NN/%/%/talker/later") == NODE


WRONG_CHUNKS = {
    0: ["@ros2_lw"],
    1: ["-1", "x", "\u0663"],
    2: ["8B20", "0" * 33, "0x1", "0", "01a"],  # the last would have the GUID of session 1a
    3: ["1.0"],
    4: ["9" * 5000],
    5: ["XX", "mp"],
    12: ["::,10"],
}
NO_TOKENS = ["", "/", "@ros2_lv", "@ros2_lv/0/**", TALKER + "/", "/" * 5000, "@ros2_lv/" * 5000]


def invalid_tokens() -> Iterator[str]:
    for place in range(13):
        for new in ([], [""], *([chunk] for chunk in WRONG_CHUNKS.get(place, ()))):
            chunks = TALKER.split("/")
            chunks[place : place + 1] = new
            yield "/".join(chunks)


@pytest.mark.parametrize("text", [*NO_TOKENS, *invalid_tokens()])
def test_invalid_liveliness_token_returns_none(text: str) -> None:
    assert read_token(text) is None


CHUNKS = st.one_of(st.sampled_from(sorted({*TALKER.split("/"), "NN", "", "%"})), st.text(max_size=20))


@given(st.one_of(st.text(), st.lists(CHUNKS, max_size=16).map("/".join)))
def test_any_token_text_is_read_without_error(text: str) -> None:
    read_token(text)


WORDS = st.from_regex(r"[a-z][a-z0-9_]{0,8}", fullmatch=True)
NAMES = st.lists(WORDS, min_size=1, max_size=3).map(lambda parts: "/" + "/".join(parts))
NODES = st.builds(
    NodeToken,
    st.integers(0, 232),
    st.integers(1, 2**128 - 1).map("{:x}".format),
    st.integers(0, 2**32),
    WORDS,
    st.one_of(st.just("/"), NAMES),
    st.one_of(st.just("/"), NAMES),
)
ENDPOINTS = st.builds(
    EndpointToken,
    NODES,
    st.integers(0, 2**32),
    st.sampled_from([kind for kind in EntityKind if kind is not EntityKind.NODE]),
    NAMES,
    st.just(STRING),
    st.sampled_from([HASH, "TypeHashNotSupported"]),
    PROFILES.map(announced),
    st.sampled_from(["", CPU_BACKEND]),
)


@given(st.one_of(NODES, ENDPOINTS))
def test_liveliness_tokens_round_trip_through_text(token: NodeToken | EndpointToken) -> None:
    assert read_token(str(token)) == token


# -------------------------------------------------------------------------------------------------------------- gids


def test_gid_is_the_hash_of_the_token() -> None:
    assert gid_of(TALKER).hex() == "eb85fa883b7846dc448a4501890ad062"
