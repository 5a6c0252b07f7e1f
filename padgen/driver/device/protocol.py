"""The serial protocol between a computer and a pad's microcontroller: messages ↔ bytes (docs/protocol.md).

A packet is version, kind, sequence number, payload and CRC-32, its zeros taken out by consistent overhead
byte stuffing (Cheshire and Baker, IEEE/ACM Trans. Networking 7 (1999) 159), with a zero before and after. So
a zero on the line is always an end: whatever was lost or added, the next packet is read.
"""

import struct
from dataclasses import dataclass
from enum import IntEnum
from hashlib import sha256
from typing import NamedTuple
from zlib import crc32

import numpy as np

from padgen.measured.tuning import Tuning, tuning_to_json
from padgen.planner.plan import Plan, plan_to_json

__all__ = [
    "GREETING_BYTES",
    "HOLD_WATCHDOGS",
    "VERSION",
    "Greeting",
    "Kind",
    "Message",
    "Reason",
    "Refusal",
    "State",
    "decode",
    "encode",
    "frame_message",
    "greeting",
    "plan_hash",
    "refusal",
]

VERSION = 1
HASH_BYTES = 8
FULL_LEVEL = 255
SEQUENCES = 1 << 16
HEAD, TAIL = struct.Struct("<BBH"), struct.Struct("<I")
GREETING = struct.Struct(f"<{HASH_BYTES}sHHBBHIIIII")
REFUSAL = struct.Struct("<BBH")
GREETING_BYTES = GREETING.size
LONGEST_BLOCK = 254
HOLD_WATCHDOGS = 8
"""Times of the watchdog that a frame is held for, whatever else than a new frame comes."""


class Kind(IntEnum):
    """What a message is; below 128 from the computer, the others are answers."""

    HELLO = 1
    FRAME = 2
    FRAME_BITS = 3
    SILENCE = 4
    PING = 5
    GREETING = 129
    ACK = 130
    NAK = 131


class State(IntEnum):
    """What a device does, as its ACKs tell."""

    SILENT = 0
    SWITCHING = 1
    HOLDING = 2


class Reason(IntEnum):
    """Why a message was refused."""

    DAMAGED = 1
    VERSION = 2
    KIND = 3
    LENGTH = 4
    STRANGER = 5
    DUPLICATE = 6
    ORDER = 7
    BUSY = 8


@dataclass(frozen=True, slots=True)
class Message:
    """One message; `version` is that of its sender."""

    kind: int
    sequence: int
    payload: bytes = b""
    version: int = VERSION


class Greeting(NamedTuple):
    """What a device tells of itself; times as its samples make them."""

    plan_hash: bytes
    taxels: int
    coils: int
    channels: int
    scheme: int
    next_sequence: int
    rate_hz: int
    frame_us: int
    least_frame_us: int
    watchdog_ms: int
    silence_ms: int


class Refusal(NamedTuple):
    """The kind of message that was refused (0 unknown), why, and the sequence number that is due."""

    kind: int
    reason: int
    next_sequence: int


def plan_hash(plan: Plan, tuning: Tuning | None = None) -> bytes:
    """By what computer and device know that they speak of the same pad: the SHA-256 of plan and tuning, cut short."""
    told = plan_to_json(plan) + ("" if tuning is None else tuning_to_json(tuning))
    return sha256(told.encode()).digest()[:HASH_BYTES]


def encode(message: Message) -> bytes:
    """The packet of a message, both zeros with it."""
    head = HEAD.pack(message.version, message.kind, message.sequence % SEQUENCES)
    body = head + message.payload
    return b"\0" + _stuffed(body + TAIL.pack(crc32(body))) + b"\0"


def decode(stream: bytes) -> tuple[list[Message | None], bytes]:
    """The messages of `stream`, None for each that is damaged, and the bytes that are still without an end."""
    *packets, rest = stream.split(b"\0")
    return [_message(packet) for packet in packets if packet], rest


def frame_message(levels: np.ndarray, sequence: int) -> Message:
    """A frame of levels (taxels,) in 0 … 1, in the plan's order: a bit each where all are 0 or 1, else a byte each.

    Bits fill bytes from the lowest on; bytes are in steps of 1/255.
    """
    values = np.asarray(levels, float)
    if np.isin(values, (0.0, 1.0)).all():
        return Message(Kind.FRAME_BITS, sequence, np.packbits(values.astype(bool), bitorder="little").tobytes())
    return Message(Kind.FRAME, sequence, np.rint(values * FULL_LEVEL).astype(np.uint8).tobytes())


def greeting(message: Message) -> Greeting:
    """Read the payload of a `Kind.GREETING`; a longer one is a later version's.

    Raises
    ------
    ValueError
        It is shorter than this version's.
    """
    if len(message.payload) < GREETING.size:
        raise ValueError(f"a greeting has {GREETING.size} bytes, got {len(message.payload)}")
    return Greeting(*GREETING.unpack_from(message.payload))


def refusal(message: Message) -> Refusal:
    """Read the payload of a `Kind.NAK`.

    Raises
    ------
    ValueError
        It is shorter than this version's.
    """
    if len(message.payload) < REFUSAL.size:
        raise ValueError(f"a refusal has {REFUSAL.size} bytes, got {len(message.payload)}")
    return Refusal(*REFUSAL.unpack_from(message.payload))


def _message(packet: bytes) -> Message | None:
    body = _unstuffed(packet)
    if body is None or len(body) < HEAD.size + TAIL.size:
        return None
    body, check = body[: -TAIL.size], body[-TAIL.size :]
    if crc32(body) != TAIL.unpack(check)[0]:
        return None
    version, kind, sequence = HEAD.unpack_from(body)
    return Message(kind, sequence, body[HEAD.size :], version)


def _stuffed(body: bytes) -> bytes:
    """Every zero replaced by the distance to the next one, in blocks of at most 254 bytes."""
    blocks = []
    for run in body.split(b"\0"):
        while len(run) >= LONGEST_BLOCK:
            blocks.append(b"\xff" + run[:LONGEST_BLOCK])
            run = run[LONGEST_BLOCK:]
        blocks.append(bytes([len(run) + 1]) + run)
    return b"".join(blocks)


def _unstuffed(packet: bytes) -> bytes | None:
    """The body of a packet without its zeros; None where its blocks do not come out even."""
    body, start = bytearray(), 0
    while start < len(packet):
        code = packet[start]
        block = packet[start + 1 : start + code]
        if len(block) != code - 1:
            return None
        body += block
        start += code
        if code - 1 < LONGEST_BLOCK and start < len(packet):
            body.append(0)
    return bytes(body)
