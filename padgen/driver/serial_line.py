"""Frames over a serial port to a pad's microcontroller, each shown once and in order (docs/protocol.md).

A packet is version, kind, sequence number, payload and CRC-32, its zeros taken out by consistent overhead
byte stuffing (Cheshire and Baker, IEEE/ACM Trans. Networking 7 (1999) 159), with a zero before and after. So
a zero on the line is always an end: whatever was lost or added, the next packet is read.

One message at a time is on its way, and sent again until it is answered; the device refuses what is damaged, what it
has shown and what is not due. Whatever ends the playing, the device falls silent: it
is told to, and where the line is gone its watchdog does it.
"""

import struct
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from enum import IntEnum, IntFlag
from hashlib import sha256
from importlib import import_module
from math import ceil
from typing import Any, NamedTuple
from zlib import crc32

import numpy as np

from padgen.core.errors import EngineMissingError, FileError, SpecError, at_least, number
from padgen.driver.excitation import sweep_table
from padgen.driver.loads import refuse_frames
from padgen.driver.signs import PlayedPad, choose_signs
from padgen.driver.waveform import CONTROLLER_RATES_HZ, SECONDS, drive_at, ramp_s, timeline
from padgen.driver.waveform import frame_s as planned_frame_s
from padgen.measured.tuning import Tuning, tuning_to_json
from padgen.planner.plan import Plan, plan_to_json

try:
    import termios

    LINE_ERRORS: tuple[type[Exception], type[Exception]] = (OSError, termios.error)
except ImportError:
    LINE_ERRORS = (OSError, OSError)
"""Errors that a lost line raises; pyserial's is an OSError, that of a Unix terminal is not."""

__all__ = [
    "BAUD",
    "EXTRA",
    "HOLD_WATCHDOGS",
    "VERSION",
    "Greeting",
    "Kind",
    "Message",
    "Played",
    "Reason",
    "Refusal",
    "State",
    "decode",
    "encode",
    "excite",
    "frame_message",
    "greeting",
    "plan_hash",
    "play_frames",
    "refusal",
    "serial_ports",
]

VERSION = 1
HASH_BYTES = 8
FULL_LEVEL = 255
SEQUENCES = 1 << 16
HEAD = struct.Struct("<BBH")
TAIL = struct.Struct("<I")
GREETING = struct.Struct(f"<{HASH_BYTES}sHHBBHIIIII")
REFUSAL = struct.Struct("<BBH")
COIL = struct.Struct("<H")
GIVEN = 4
"""Place, among the bytes of an ACK, of the share of the voltage that is given."""
LONGEST_BLOCK = 254
EXTRA = "play"
BAUD = 115_200
BITS_A_BYTE = 10
TRIES = 8
LEAST_REPLY_S = 0.2
BUSY_S = 0.005
GREET_S = 5.0
"""Longest wait in s for a device's first answer: many boards start anew when their port is opened."""
PINGS = 3
"""Signs of life in the time after which the device's watchdog would silence it."""
HOLD_SHARE = 0.5
"""Share of the time for which the device holds a frame after which it is sent again."""
READ_BYTES = 4096
HOLD_WATCHDOGS = 8
"""Times of the watchdog that a frame is held for, whatever else than a new frame comes."""


class Kind(IntEnum):
    """The kinds of messages; those below 128 are from the computer, the others are answers."""

    HELLO = 1
    FRAME = 2
    FRAME_BITS = 3
    SILENCE = 4
    PING = 5
    EXCITE = 6
    GREETING = 129
    ACK = 130
    NAK = 131


class State(IntEnum):
    """The state of a device's coils by its acknowledgements (ACK): silent, switching or holding a frame."""

    SILENT = 0
    SWITCHING = 1
    HOLDING = 2


class Reason(IntEnum):
    """The reasons for refusing a message."""

    DAMAGED = 1
    VERSION = 2
    KIND = 3
    LENGTH = 4
    STRANGER = 5
    DUPLICATE = 6
    ORDER = 7
    BUSY = 8
    FAULT = 9


@dataclass(frozen=True, slots=True)
class Message:
    """One message; `version` is that of its sender."""

    kind: int
    sequence: int
    payload: bytes = b""
    version: int = VERSION


class Greeting(NamedTuple):
    """A device's report on itself; its times are whole numbers of samples, `faults` are `Fault` flags.

    Older firmware sends no faults: they are then 0.
    """

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
    faults: int = 0


class Fault(IntFlag):
    """Faults that a device's self-test may find; with any of them it stays silent."""

    TABLES = 1
    CLAMP = 2
    ARITHMETIC = 4


class Refusal(NamedTuple):
    """A device's refusal: kind of the refused message (0 unknown), reason, and the sequence number that it expects."""

    kind: int
    reason: int
    next_sequence: int


def plan_hash(plan: Plan, tuning: Tuning | None = None) -> bytes:
    """Return the shortened SHA-256 of plan and tuning: if computer and device have the same, they mean the same pad."""
    text = plan_to_json(plan) + ("" if tuning is None else tuning_to_json(tuning))
    return sha256(text.encode()).digest()[:HASH_BYTES]


def encode(message: Message) -> bytes:
    """Return the packet of a message, with the zero bytes before and after it."""
    body = HEAD.pack(message.version, message.kind, message.sequence % SEQUENCES) + message.payload
    blocks = []
    # Every zero is replaced by the distance to the next one, in blocks of at most 254 bytes.
    for run in (body + TAIL.pack(crc32(body))).split(b"\0"):
        while len(run) >= LONGEST_BLOCK:
            blocks.append(b"\xff" + run[:LONGEST_BLOCK])
            run = run[LONGEST_BLOCK:]
        blocks.append(bytes([len(run) + 1]) + run)
    return b"\0" + b"".join(blocks) + b"\0"


def decode(stream: bytes) -> tuple[list[Message | None], bytes]:
    """Return the messages of `stream` (None for each damaged one), and the bytes of the incomplete last packet."""
    *packets, rest = stream.split(b"\0")
    return [_message(packet) for packet in packets if packet], rest


def frame_message(levels: np.ndarray, sequence: int) -> Message:
    """Pack levels (taxels,) in −1 … 1, in the plan's order: a bit each where all are 0 or ±1, else a byte each.

    Bits fill bytes from the lowest on; bytes are in steps of 1/255. Where a level is below 0, a bit each follows: 1 for
    a taxel that moves in counter-phase.
    """
    values = np.abs(np.asarray(levels, float))
    turned = np.asarray(levels) < 0
    signs = _bits(turned) if turned.any() else b""
    if np.isin(values, (0.0, 1.0)).all():
        return Message(Kind.FRAME_BITS, sequence, _bits(values == 1) + signs)
    return Message(Kind.FRAME, sequence, np.rint(values * FULL_LEVEL).astype(np.uint8).tobytes() + signs)


def _bits(values: np.ndarray) -> bytes:
    return np.packbits(values, bitorder="little").tobytes()


def greeting(message: Message) -> Greeting:
    """Read the payload of a `Kind.GREETING`, leaving out bytes that a later version may append."""
    return Greeting(*GREETING.unpack_from(message.payload), *message.payload[GREETING.size : GREETING.size + 1])


def refusal(message: Message) -> Refusal:
    """Read the payload of a `Kind.NAK`."""
    return Refusal(*REFUSAL.unpack_from(message.payload))


def _message(packet: bytes) -> Message | None:
    """Return the message of a packet without its zero bytes; None where its blocks or its checksum are wrong."""
    body = b""
    start = 0
    while start < len(packet):
        code = packet[start]
        block = packet[start + 1 : start + code]
        if len(block) != code - 1:
            return None
        start += code
        body += block + b"\0" * (code - 1 < LONGEST_BLOCK and start < len(packet))
    body, check = body[: -TAIL.size], body[-TAIL.size :]
    if len(body) < HEAD.size or crc32(body) != TAIL.unpack(check)[0]:
        return None
    version, kind, sequence = HEAD.unpack_from(body)
    return Message(kind, sequence, body[HEAD.size :], version)


@dataclass(frozen=True, slots=True)
class Played:
    """The result of playing: `resent` messages were sent again, since the line had lost or changed them.

    `given` is the smallest share of its voltage that a coil was given, below 1 where it was as warm as it bears.
    """

    port: str
    device: Greeting
    frames: int
    resent: int
    seconds: float
    given: float


def serial_ports() -> list[str]:
    """Return the names of the serial ports that there are.

    Raises
    ------
    EngineMissingError
        pyserial is not installed.
    """
    _serial()
    return sorted(str(port.device) for port in import_module("serial.tools.list_ports").comports())


def play_frames(
    port: str,
    plan: Plan,
    frames: np.ndarray,
    frame_s: float | None = None,
    *,
    tuning: Tuning | None = None,
    baud: int = BAUD,
    reply_s: float | None = None,
    greet_s: float = GREET_S,
    on_shown: Callable[[int], None] = lambda shown: None,
) -> Played:
    """Show frames (k, taxels) of levels in 0 … 1, each for `frame_s` (None: the device's frame time), then silence.

    Taxels of one frequency have the signs with which they shake the pad least. The device must hold the firmware of
    this plan and `tuning`. `on_shown` hears how many are shown. An answer is waited for `reply_s` (None: by what the
    line needs).

    Raises
    ------
    SpecError
        Levels or times that the pad cannot show, or the line cannot carry; frames that are beyond a limit.
    FileError
        The port cannot be opened, nothing answers, it holds another pad or protocol, or the line broke.
    EngineMissingError
        pyserial is not installed.
    """
    timeline(plan, frames, frame_s)
    frames = np.atleast_2d(np.asarray(frames, float))
    refuse_frames(plan, frames, tuning)
    frames = frames * _signs(plan, frames, frame_s, tuning)
    bytes_each = max(len(encode(frame_message(frame, 0))) for frame in frames)
    least_s = bytes_each * BITS_A_BYTE / baud
    reply_s = max(LEAST_REPLY_S, 4 * least_s) if reply_s is None else reply_s
    with _playing(port, plan, tuning, baud, reply_s, greet_s, f"frame 0 of {len(frames)}") as link:
        each = frame_s or link.device.frame_us * 1e-6
        if each < least_s:
            raise SpecError(
                f"a frame of {bytes_each} bytes needs at least {at_least(least_s)} s at {baud} baud,"
                f" got {number(each)} s",
                SECONDS,
            )
        began = time.monotonic()
        link.show_all(frames, each, on_shown)
        with link.lost_line_as_error("the last frame"):  # which is reached before all falls silent
            link.wait_for([State.SILENT, State.HOLDING])
            link.ask(Kind.SILENCE)
            link.wait_for([State.SILENT])
        return Played(port, link.device, len(frames), link.resent, time.monotonic() - began, link.given / FULL_LEVEL)


def _signs(plan: Plan, frames: np.ndarray, each_s: float | None, tuning: Tuning | None) -> np.ndarray:
    """Return signs (k, taxels) of motion in frames that shake the pad least; all +1 if those exceed a limit."""
    drive = drive_at(plan, CONTROLLER_RATES_HZ, tuning=tuning)
    held_s = (each_s or planned_frame_s(plan)) - ramp_s(plan) / 2
    signs = choose_signs(PlayedPad(plan, drive, tuning), frames, held_s, plan.scheme.takes_turns)
    try:
        refuse_frames(plan, frames * signs, tuning)
    except SpecError:
        return np.ones(frames.shape)
    return signs


def excite(port: str, plan: Plan, coil: int, *, tuning: Tuning | None = None, baud: int = BAUD) -> None:
    """Let the device play its sweep on one coil (an index, row by row), and wait for the end.

    Raises
    ------
    FileError, EngineMissingError
        As `play_frames` does.
    """
    what = "the sweep"
    with _playing(port, plan, tuning, baud, LEAST_REPLY_S, GREET_S, what) as link, link.lost_line_as_error(what):
        link.ask(Kind.EXCITE, COIL.pack(coil))
        link.wait_for([State.SILENT], 2 * sweep_table(plan).seconds)


@contextmanager
def _playing(
    port: str, plan: Plan, tuning: Tuning | None, baud: int, reply_s: float, greet_s: float, what: str
) -> "Iterator[_Link]":
    """Open a serial line for a ``with`` block and check the device's plan; silence the device if the block fails."""
    serial = _serial()
    try:
        line = serial.Serial(port, baud, timeout=0, write_timeout=2.0, exclusive=True)
    except (*LINE_ERRORS, ValueError, OverflowError) as error:
        there = ", ".join(serial_ports()) or "none"
        raise FileError(f"cannot be opened ({_reason(error)}); serial ports that there are: {there}", port) from error
    link = _Link(line, port, reply_s)
    try:
        with link.lost_line_as_error(what):
            link.greet(plan, tuning, greet_s)
        try:
            yield link
        except BaseException:
            with suppress(*LINE_ERRORS, FileError):  # the error that is on its way matters more
                link.ask(Kind.SILENCE)
            raise
    finally:
        with suppress(*LINE_ERRORS):
            line.close()


class _Link:
    """The computer's end of an open serial line; `device` is set once the device has answered `greet`."""

    device: Greeting

    def __init__(self, line: Any, port: str, reply_s: float) -> None:
        self.resent = 0
        self.given = FULL_LEVEL
        self._line = line
        self._port = port
        self._reply_s = reply_s
        self._rest = b""
        self._tag = 0
        self._what_then = "the device is as it was"

    def greet(self, plan: Plan, tuning: Tuning | None, greet_s: float) -> None:
        """Ask the device what it holds; raise FileError unless that is this plan and tuning, without faults."""
        wanted = plan_hash(plan, tuning)
        end = time.monotonic() + greet_s
        answer = None
        while answer is None or (answer.version == VERSION and answer.kind != Kind.GREETING):
            if time.monotonic() > end:
                raise FileError(
                    f"nothing answers within {number(greet_s)} s; is the firmware on the device, and is this its port"
                    " and speed?",
                    self._port,
                )
            answer = self._once(Message(Kind.HELLO, 1, wanted))
        cure = "write its firmware anew with padgen drive --formats c, and compile it"
        if answer.version != VERSION:
            raise FileError(
                f"speaks version {answer.version} of the protocol, this padgen version {VERSION}; {cure}", self._port
            )
        self.device = greeting(answer)
        if self.device.plan_hash != wanted:
            raise FileError(
                f"holds another pad or print ({self.device.taxels} taxels, {self.device.plan_hash.hex()}) than"
                f" {plan.name!r} ({len(plan.taxels)} taxels, {wanted.hex()}); {cure}, or name its tuning (--tuning)",
                self._port,
            )
        if self.device.faults:
            faults = ", ".join(str(fault.name).lower() for fault in Fault if fault & self.device.faults)
            raise FileError(
                f"found its {faults or 'self'} wrong when it tested itself, and stays silent; {cure}", self._port
            )
        seconds = round((self.device.watchdog_ms + self.device.silence_ms) * 1e-3, 2)
        self._what_then = f"the device falls silent by itself within {number(seconds)} s"

    def show_all(self, frames: np.ndarray, each_s: float, on_shown: Callable[[int], None]) -> None:
        """Show every frame at its time; after a late frame those that follow are delayed, so that none is too short.

        A frame that is to last longer than the device holds one is sent again meanwhile, which no taxel feels.
        """
        least_s = self.device.least_frame_us * 1e-6
        parts = ceil(each_s / (HOLD_SHARE * HOLD_WATCHDOGS * self.device.watchdog_ms * 1e-3))
        sequence = self.device.next_sequence
        due = time.monotonic()
        for k, frame in enumerate(frames):
            with self.lost_line_as_error(f"frame {k + 1} of {len(frames)}"):
                for _ in range(parts):
                    self._show(frame_message(frame, sequence % SEQUENCES))
                    sequence += 1
                    on_shown(k + 1)
                    due = max(due + each_s / parts, time.monotonic() + least_s)
                    self._wait(due)

    @contextmanager
    def lost_line_as_error(self, what: str) -> Iterator[None]:
        """Raise FileError, which says that `what` was under way, if the serial line is lost within the block."""
        try:
            yield
        except LINE_ERRORS as error:
            raise FileError(f"the line closed in {what} ({_reason(error)}); {self._what_then}", self._port) from error

    def ask(self, kind: Kind, payload: bytes = b"") -> Message:
        """Send a message that is no frame, and return its answer."""
        self._tag = (self._tag + 1) % SEQUENCES
        return self._ask(Message(kind, self._tag, payload))

    def wait_for(self, states: list[State], longest_s: float = 0.0) -> None:
        """Wait until the device is in one of these states; raise FileError where that takes too long."""
        longest_s = max(longest_s, self.device.silence_ms * 1e-3, 2e-6 * self.device.least_frame_us)
        end = time.monotonic() + longest_s + TRIES * self._reply_s
        while self.ask(Kind.PING).payload[1] not in states:
            if time.monotonic() > end:
                raise FileError("the device does not come to rest", self._port)
            time.sleep(BUSY_S)

    def _show(self, message: Message) -> None:
        """Send a frame until the device has accepted it; while it is busy with the frame before, send it again."""
        end = time.monotonic() + 2 * self.device.least_frame_us * 1e-6 + TRIES * self._reply_s
        while True:
            answer = self._ask(message, (Reason.DUPLICATE, Reason.BUSY))
            if answer.kind == Kind.ACK or refusal(answer).reason == Reason.DUPLICATE:
                return
            if time.monotonic() > end:
                raise FileError("the device does not come to an end with the frame before", self._port)
            time.sleep(BUSY_S)

    def _wait(self, until: float) -> None:
        """Wait until a time, and ping the device meanwhile, so that its watchdog does not silence it."""
        pause = self.device.watchdog_ms * 1e-3 / PINGS
        while (left := until - time.monotonic()) > pause:
            time.sleep(pause)
            self.ask(Kind.PING)
        time.sleep(max(left, 0.0))

    def _ask(self, message: Message, expected: tuple[Reason, ...] = ()) -> Message:
        """Send a message until it is answered; raise FileError for a refusal that is not among the `expected` ones."""
        for attempt in range(TRIES):
            self.resent += attempt > 0
            answer = self._once(message)
            if answer is None:
                continue
            if answer.kind == Kind.ACK:
                self.given = min([self.given, *answer.payload[GIVEN : GIVEN + 1]])
            if answer.kind == Kind.ACK or refusal(answer).reason in expected:
                return answer
            raise FileError(self._refused(refusal(answer).reason), self._port)
        raise FileError(f"no answer in {TRIES} tries of {number(self._reply_s)} s each; {self._what_then}", self._port)

    def _refused(self, reason: int) -> str:
        if reason in (Reason.KIND, Reason.LENGTH):
            return "the device's firmware is an older one; write it anew with padgen drive --formats c, and compile it"
        if reason in (Reason.STRANGER, Reason.ORDER):
            return "the device began anew while it played: was it reset, or does another program use its port?"
        name = Reason(reason).name.lower() if reason in list(Reason) else str(reason)
        return f"the device refused a message ({name}); {self._what_then}"

    def _once(self, message: Message) -> Message | None:
        """Send a message once and return its answer; None where none came, or the device says that it came damaged."""
        self._line.write(encode(message))
        end = time.monotonic() + self._reply_s
        while (left := end - time.monotonic()) > 0:
            self._line.timeout = left
            stream = self._rest + self._line.read(max(1, min(self._line.in_waiting, READ_BYTES)))
            messages, self._rest = decode(stream)
            for answer in messages:
                if answer is not None and _answers(answer, message):
                    damaged = answer.kind == Kind.NAK and answer.version == VERSION
                    return None if damaged and refusal(answer).reason == Reason.DAMAGED else answer
        return None


def _answers(answer: Message, message: Message) -> bool:
    """Return whether a reply is the one to this message, or one that says that a message came damaged."""
    if answer.version != VERSION:
        return message.kind == Kind.HELLO and answer.kind >= Kind.GREETING
    if answer.kind in (Kind.ACK, Kind.NAK) and len(answer.payload) >= (2 if answer.kind == Kind.ACK else REFUSAL.size):
        damaged = answer.kind == Kind.NAK and refusal(answer).reason == Reason.DAMAGED
        return damaged or (answer.payload[0], answer.sequence) == (message.kind, message.sequence)
    return answer.kind == Kind.GREETING and message.kind == Kind.HELLO and len(answer.payload) >= GREETING.size


def _serial() -> Any:
    try:
        return import_module("serial")
    except ImportError as error:
        raise EngineMissingError(
            f"needs the package pyserial ({error}); pip install 'padgen[{EXTRA}]' brings it", "--port"
        ) from error


def _reason(error: Exception) -> str:
    return str(getattr(error, "strerror", None) or error or type(error).__name__)
