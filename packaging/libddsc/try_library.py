"""Try the library of an installed wheel: what rosidl-py-gen calls is there, and samples go from process to process.

Nothing but the standard library and the wheel is needed. Traffic stays on the loopback interface.

    python try_library.py          the library of rosidl_libddsc
    python try_library.py FILE     another one
"""

from __future__ import annotations

import ctypes
import os
import subprocess
import sys
import time

DOMAIN = 117
ON_LOOPBACK = """<CycloneDDS><Domain>
<General><AllowMulticast>false</AllowMulticast>
<Interfaces><NetworkInterface address="127.0.0.1"/></Interfaces></General>
<Discovery><ParticipantIndex>auto</ParticipantIndex><Peers><Peer address="127.0.0.1"/></Peers></Discovery>
</Domain></CycloneDDS>"""
PATIENCE_S = 30.0
SAMPLE = 42

CALLED = [
    "dds_create_topic",
    "dds_create_topic_sertype",
    "dds_entity_pin",
    "dds_entity_unpin",
    "dds_qset_data_representation",
    "dds_takecdr",
    "dds_writecdr",
    "ddsi_serdata_from_ser",
    "ddsi_serdata_from_ser_iov",
    "ddsi_serdata_ref",
    "ddsi_serdata_size",
    "ddsi_serdata_to_ser_ref",
    "ddsi_serdata_to_ser_unref",
    "ddsi_serdata_unref",
    "ddsi_sertype_derive_sertype",
    "ddsi_sertype_ref",
    "ddsi_sertype_unref",
    "ddsi_sertype_v0",
]
SINCE_0_11 = ["dds_get_entity_sertype"]  # rosidl-py-gen finds another way where it is missing


class Descriptor(ctypes.Structure):
    """dds_topic_descriptor_t, of a struct of one octet."""

    _fields_ = (
        *((name, ctypes.c_uint32) for name in ("size", "align", "flagset", "nkeys")),
        ("typename", ctypes.c_char_p),
        ("keys", ctypes.c_void_p),
        ("nops", ctypes.c_uint32),
        ("ops", ctypes.POINTER(ctypes.c_uint32)),
        ("meta", ctypes.c_char_p),
        ("type_information", ctypes.c_void_p),
        ("type_information_size", ctypes.c_uint32),
        ("type_mapping", ctypes.c_void_p),
        ("type_mapping_size", ctypes.c_uint32),
        ("restrict_data_representation", ctypes.c_uint32),
    )


ADR_1BY, RTS = 0x01010000, 0
OPS = (ctypes.c_uint32 * 3)(ADR_1BY, 0, RTS)
OCTET = Descriptor(1, 1, 0, 0, b"try_library::Octet", None, 2, OPS)


def call(library: ctypes.CDLL, name: str, *arguments: object) -> int:
    """A function that answers an entity, a count or 0, and what is negative when it fails."""
    answer = int(getattr(library, name)(*arguments))
    if answer < 0:
        raise SystemExit(f"{name} answered {answer}")
    return answer


def endpoint(library: ctypes.CDLL, create: str) -> int:
    participant = call(library, "dds_create_participant", ctypes.c_uint32(DOMAIN), None, None)
    topic = call(library, "dds_create_topic", participant, ctypes.byref(OCTET), b"try_library", None, None)
    return call(library, create, participant, topic, None, None)


def take(library: ctypes.CDLL) -> None:
    """Wait for the sample; the child process does this."""
    reader = endpoint(library, "dds_create_reader")
    value = ctypes.c_uint8()
    samples = (ctypes.c_void_p * 1)(ctypes.addressof(value))
    information = ctypes.create_string_buffer(256)
    until = time.monotonic() + PATIENCE_S
    while time.monotonic() < until:
        if call(library, "dds_take", reader, samples, information, ctypes.c_size_t(1), ctypes.c_uint32(1)):
            raise SystemExit(0 if value.value == SAMPLE else f"took {value.value}, expected {SAMPLE}")
        time.sleep(0.02)
    raise SystemExit("took nothing")


def write(library: ctypes.CDLL, reader: subprocess.Popen[bytes]) -> None:
    """Write until the other process has taken one."""
    writer = endpoint(library, "dds_create_writer")
    value = ctypes.c_uint8(SAMPLE)
    while reader.poll() is None:
        call(library, "dds_write", writer, ctypes.byref(value))
        time.sleep(0.02)


def main() -> None:
    arguments = [word for word in sys.argv[1:] if word != "--take"]
    if arguments:
        file = arguments[0]
    else:
        from rosidl_libddsc import path  # type: ignore[import-not-found, unused-ignore]

        file = str(path())
    os.environ["CYCLONEDDS_URI"] = ON_LOOPBACK
    library = ctypes.CDLL(file)
    if "--take" in sys.argv:
        take(library)
    print(file)
    missing = [name for name in CALLED if not hasattr(library, name)]
    if missing:
        raise SystemExit(f"not there: {' '.join(missing)}")
    print(f"{len(CALLED)} functions are there; of later versions: {[n for n in SINCE_0_11 if hasattr(library, n)]}")
    reader = subprocess.Popen([sys.executable, __file__, "--take", *arguments])
    try:
        write(library, reader)
        if reader.returncode:
            raise SystemExit("no sample was taken")
    finally:
        reader.kill()
    print("a sample went from process to process")


if __name__ == "__main__":
    main()
