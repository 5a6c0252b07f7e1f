"""The firmware compiled for this computer and run by scripts, for the tests of firmware and play."""

import os
import shutil
import subprocess
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

import padgen as pg
from padgen.driver.formats.c import FILE, c_header, firmware_files
from padgen.driver.loads import HEAT_S
from padgen.driver.serial_line import Kind, Message, decode, encode, frame_message, plan_hash
from padgen.driver.waveform import PadDrive, make_drive
from padgen.planner import Plan
from padgen.spec import parse_spec
from padgen.spec.model import Amplifier, LimitsTable

SANITIZED = ["-fsanitize=address,undefined,float-cast-overflow", "-fno-sanitize-recover=all"]
STRICT = ["-O1", "-Wall", "-Wextra", "-Werror", "-pedantic"]

DRUM = """
resolution = {taxels}
band_hz = [40, 700]
q_min = 15
drive = "{drive}"
[pad]
width_mm = 100
depth_mm = 100
[washer]
name = "iso7092-m3"
[coil]
name = "drum-44"
source = "an estimate"
outer_diameter_mm = 44
inner_diameter_mm = 16
length_mm = 20
turns = 1200
resistance_ohm = 12
inductance_mh = {inductance_mh}
core_diameter_mm = 16
core_relative_permeability = 1000
gap_mm = 1.5
grid = [2, 2]
{more}
"""


@cache
def drum(name: str, taxels: int, drive: str, inductance_mh: float = 61, more: str = "") -> Plan:
    """Plan a pad over four large coils, with any scheme and with empty places."""
    text = f'name = "{name}"\n' + DRUM.format(taxels=taxels, drive=drive, inductance_mh=inductance_mh, more=more)
    return pg.plan(parse_spec(text))


@cache
def quick() -> Plan:
    """Plan a pad of one channel, so high that frames may be short."""
    return pg.plan(parse_spec(QUICK))


@cache
def magnets() -> Plan:
    """Plan a pad of magnets, which the current itself pulls and pushes."""
    return pg.plan(parse_spec(QUICK + 'magnet = "disc-3x1"\ncoil.name = "air-10"\ndrive.level_um = 60\n'))


QUICK = """
name = "quick"
resolution = 16
band_hz = [50, 400]
q_min = 15
resonances_hz = [300]
coil.grid = [4, 4]
"""

PADS: dict[str, tuple[Callable[[], Plan], int, float | None]] = {
    "one": (lambda: pg.plan("paper-16"), 8000, None),
    "quick": (quick, 8000, None),
    "tones": (lambda: drum("tones", 14, "tones", more='reuse = "alternate"'), 16000, None),
    "spur-free": (lambda: drum("spur-free", 16, "spur-free"), 16000, None),
    "no inductance": (lambda: drum("no-inductance", 12, "spur-free", 0), 16000, None),
    "carrier": (lambda: drum("carrier", 12, "spur-free"), 48000, 8000.0),
    "eleven": (lambda: pg.plan("wide-11"), 16000, None),
    "biased": (lambda: drum("biased", 13, "biased"), 16000, None),
    "time-shared": (lambda: drum("time-shared", 11, "time-shared", 10), 8000, None),
    "magnet": (magnets, 16000, None),
    "big": (lambda: pg.plan("big-512"), 8000, None),
}
"""Pads by name: the function that plans each, its samples a second, its carrier in Hz. Some coils have fewer taxels."""


FULL_V = 2000.0
"""Voltage limit above all that these pads ask for."""


def compiler(variable: str, name: str, package: str) -> str:
    """Return the path of a compiler, without which the firmware cannot be tested."""
    found = shutil.which(os.environ.get(variable, name))
    assert found, f"no compiler {os.environ.get(variable, name)!r}; make test installs {package}"
    return found


@dataclass(frozen=True)
class Run:
    """The result of a script: volts (samples, coils), answers in order, lines of the log."""

    volts: np.ndarray
    answers: list[Message | None]
    log: list[str]

    @property
    def begun(self) -> list[list[int] | None]:
        """The levels of every frame that began, None for a silence."""
        began = [line.split()[2:] for line in self.log if line.startswith("begin")]
        return [list(bytes.fromhex(levels[0])) if levels else None for _, *levels in began]

    @property
    def is_silent(self) -> bool:
        return "silent" in self.log[-2]


@dataclass(frozen=True)
class Host:
    """A compiled firmware in its folder, and the pad it was compiled for."""

    plan: Plan
    drive: PadDrive
    folder: Path

    @property
    def program(self) -> Path:
        return self.folder / "padgen_host"

    def number(self, name: str) -> int:
        """Return a whole number that the header defines."""
        text = (self.folder / FILE).read_text()
        return int(text.split(f"#define {name} ")[1].split()[0].rstrip("u"))

    def run(self, script: str, *options: str) -> Run:
        """Run the firmware with a script of `feed` and `run` lines."""
        volts = self.folder / "volts"
        log = self.folder / "log"
        command = [self.program, "script", "--volts", volts, "--log", log, *options]
        done = subprocess.run(command, input=script, capture_output=True, text=True, timeout=60)
        assert done.returncode == 0, done.stderr
        sent = "".join(line.removeprefix("send ") for line in done.stdout.splitlines())
        answers, rest = decode(bytes.fromhex(sent))
        assert not rest
        samples = np.fromfile(volts, np.float32).reshape(-1, len(self.drive.coils)).astype(float)
        return Run(samples, answers, log.read_text().splitlines())

    @property
    def hello(self) -> str:
        """The line of a script that names the pad."""
        return feed(Message(Kind.HELLO, 0, plan_hash(self.plan)))

    def wait(self, samples: int) -> str:
        """Return lines of a script that let samples pass without tripping the watchdog."""
        step = self.number("PADGEN_WATCHDOG_SAMPLES") // 2
        pings = f"run {step}\n" + feed(Message(Kind.PING, 0))
        return pings * (samples // step) + f"run {samples % step}\n"


def feed(*messages: Message | bytes) -> str:
    """Return the line of a script that sends messages, or bytes."""
    return "feed " + b"".join(m if isinstance(m, bytes) else encode(m) for m in messages).hex() + "\n"


_compiled: dict[str, Host] = {}


def host(name: str, folders: pytest.TempPathFactory) -> Host:
    """Return the firmware of one of `PADS`, compiled once with all warnings as errors."""
    if name not in _compiled:
        make, rate_hz, carrier_hz = PADS[name]
        plan = make()
        # What is compared is not cut; those that ask for more than a pad's own limit have tests of theirs.
        drive = replace(make_drive(plan, rate_hz, carrier_hz=carrier_hz), voltage_limit_v=FULL_V)
        _compiled[name] = compiled(plan, drive, folders.mktemp("firmware"))
    return _compiled[name]


def compiled(
    plan: Plan, drive: PadDrive, folder: Path, header: Callable[[str], str] = str, options: Sequence[str] = ()
) -> Host:
    """Compile the firmware of a drive in a folder, with its header changed by `header`."""
    for name, data in firmware_files().items():
        (folder / name).write_bytes(data)
    (folder / FILE).write_text(header(c_header(plan, drive)))
    sources = sorted(path.name for path in folder.glob("*.c"))
    command = [compiler("CC", "cc", "gcc"), "-std=c99", *STRICT, *options, *sources, "-lm", "-o", "padgen_host"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return Host(plan, drive, folder)


def limited(
    name: str, coil_w: float, power_w: float | None = None, current_a: float | None = None
) -> tuple[Plan, PadDrive]:
    """Return one of `PADS` whose coils bear `coil_w`, all of them `power_w`, its amplifier `current_a`; and a drive."""
    make, rate_hz, carrier_hz = PADS[name]
    plan = make()
    spec = plan.spec
    amplifier = None
    if current_a is not None:
        amplifier = Amplifier("bench", len(plan.taxels), "DC", spec.drive.voltage_limit_v, current_a)
    coil = replace(spec.coil, power_limit_w=coil_w)
    plan = replace(plan, spec=replace(spec, coil=coil, limits=LimitsTable(power_w), amplifier=amplifier))
    return plan, make_drive(plan, rate_hz, carrier_hz=carrier_hz)


class Meter:
    """What voltages do to coils, by filters at four times their rate: independent of the firmware's own account.

    `heat` is the largest of any coil over its limit, if its time constant is the shortest that the firmware assumes,
    and if it is one of `slower_s`; `total` that of all coils over the pad's limit.
    """

    FINER = 4

    def __init__(self, host: Host, slower_s: Sequence[float] = (HEAT_S, 60.0)) -> None:
        spec = host.plan.spec
        drive = host.drive
        self.coils = len(host.drive.coils)
        self.ohm = spec.coil.resistance_ohm
        self.limit_w = spec.coil.power_limit_w
        lag_s = spec.coil.inductance_mh * 1e-3 / self.ohm
        self.left = np.exp(-1 / (lag_s * drive.rate_hz * self.FINER)) if lag_s else 0.0
        self.shortest_s = 2.0 ** host.number("PADGEN_HEAT_SHIFT") / drive.rate_hz
        self.stays = [np.exp(-1 / (tau * drive.rate_hz)) for tau in (self.shortest_s, *slower_s)]
        self.pad_w = spec.limits.power_w or self.coils * self.limit_w
        self.current = np.zeros((1, self.coils))
        self.warm = [np.zeros((1, self.coils)) for _ in self.stays]
        self.volts = self.amperes = self.total = 0.0
        self.heat = [0.0] * len(self.stays)
        self.samples = 0
        self.last = np.zeros(self.coils)

    def take(self, volts: np.ndarray) -> None:
        """Go on by voltages (samples, coils)."""
        if not len(volts):
            return
        before = self.current
        fed = np.repeat(volts, self.FINER, axis=0) / self.ohm
        amperes, _ = lfilter([1 - self.left], [1, -self.left], fed, axis=0, zi=self.left * before)
        self.current = amperes[-1:]
        squares = np.concatenate([before**2, amperes**2])
        means = (squares[1:] + squares[:-1]) / 2 if self.left else squares[1:]
        lost_w = self.ohm * means.reshape(-1, self.FINER, self.coils).mean(1)
        for k, stays in enumerate(self.stays):
            warm, _ = lfilter([1 - stays], [1, -stays], lost_w / self.limit_w, axis=0, zi=stays * self.warm[k])
            self.warm[k] = warm[-1:]
            self.heat[k] = max(self.heat[k], float(warm.max()))
            self.total = max(self.total, float(warm.sum(1).max()) * self.limit_w / self.pad_w)
        self.volts = max(self.volts, float(np.abs(volts).max()))
        self.amperes = max(self.amperes, float(np.abs(amperes).max()))
        self.samples += len(volts)
        self.last = volts[-1]


def metered(host: Host, script: str, *options: str) -> Meter:
    """Run a script of any length, its voltages read by a `Meter` as they come."""
    meter = Meter(host)
    pipe = host.folder / "pipe"
    if not pipe.exists():
        os.mkfifo(pipe)
    command = [host.program, "script", "--volts", pipe, "--log", host.folder / "log", *options]
    (host.folder / "script").write_text(script)
    with (host.folder / "script").open() as lines, (host.folder / "answers").open("w") as answers:
        running = subprocess.Popen(command, stdin=lines, stdout=answers, stderr=subprocess.PIPE, text=True)
        with pipe.open("rb") as volts:
            while block := volts.read(4 * meter.coils << 14):
                meter.take(np.frombuffer(block, np.float32).reshape(-1, meter.coils).astype(float))
        _, said = running.communicate()
    assert running.returncode == 0, said
    return meter


def noise(host: Host, rng: np.random.Generator, count: int, due: int) -> Iterator[str]:
    """Yield random bytes as fast as the line brings them, now and then a frame among them, `due` the first of these."""
    taxels = len(host.plan.taxels)
    rate_hz = host.drive.rate_hz
    for start in range(0, count, 1000):
        if start % 40_000 == 0:
            yield host.hello + feed(frame_message(np.ones(taxels), due))
            due += 1
        some = rng.integers(0, 256, min(1000, count - start), dtype=np.uint8)
        # More zeros than chance has, so that there are packets of all lengths.
        some[rng.random(len(some)) < rng.choice([0.0, 0.02, 0.2])] = 0
        yield feed(some.tobytes()) + f"run {len(some) * 10 * rate_hz // 115_200}\n"


def sessions(host: Host, rng: np.random.Generator, count: int) -> Iterator[str]:
    """Yield sessions: messages in order, some of them damaged, forged, doubled or cut, with time and resets between."""
    taxels = len(host.plan.taxels)
    rate = host.drive.rate_hz
    due = 0
    for _ in range(count):
        if rng.random() < 0.3:
            yield "reset\n"
            due = 0
        yield host.hello
        for _ in range(rng.integers(1, 9)):
            levels = rng.choice([1.0, 0.0, 0.5], taxels) if rng.random() < 0.4 else np.ones(taxels)
            kind = rng.choice([Kind.FRAME, Kind.PING, Kind.SILENCE, Kind.HELLO], p=[0.7, 0.2, 0.05, 0.05])
            message = frame_message(levels, due) if kind == Kind.FRAME else Message(int(kind), 0)
            packet = bytearray(encode(message))
            change = rng.integers(0, 20)
            place = int(rng.integers(0, len(packet)))
            if change == 0:
                packet[place] ^= 1 << rng.integers(0, 8)
            elif change == 1:
                del packet[place : place + rng.integers(1, 9)]
            elif change == 2:
                packet[place:place] = rng.bytes(rng.integers(1, 9))
            elif change == 3:
                packet += bytes(packet)
            elif change == 4:
                packet = bytearray(rng.bytes(rng.integers(1, 3 * taxels)))
            elif change == 5:
                forged = Message(int(rng.integers(0, 256)), due, rng.bytes(rng.integers(0, taxels + 9)))
                packet = bytearray(encode(forged))
            away = "away" if rng.random() < 0.03 else "run"
            if kind == Kind.FRAME:
                # Frames are refused while one waits: those that may be due now are tried too.
                packet += b"".join(encode(frame_message(levels, max(due + k, 0))) for k in (-2, -1, 1))
                due += 1
            yield feed(bytes(packet)) + f"{away} {int(rng.exponential(0.12) * rate)}\n"
