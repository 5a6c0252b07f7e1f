"""The part of a Syntacts script that is the same for all pads: `padgen.driver.formats.syntacts` fills it in."""

__all__ = ["CONSTANT", "TEMPLATE"]

CONSTANT = """
The current has a constant part: the outputs and the amplifiers must pass 0 Hz.
"""

TEMPLATE = '''"""Plays the pad {name} ({scheme}) through Syntacts, one output channel for each of its {coils} coils.

    python FILE          lists the devices
    python FILE INDEX    plays on one of them

Put it beside syntacts.py and its library, which there is for Windows and macOS. Set the amplifiers so that full
scale of an output (a sample of 1) is {scale_v} V at its coil.
{constant}
Channels begin within a buffer of each other, which no taxel feels: each coil is a channel of its own.
"""

import math
import sys
import time

from syntacts import Envelope, Expression, Ramp, Repeater, Scalar, Sequence, Session, Sine

RATE_HZ = {rate}
SECONDS = {seconds}
LOOPS = {loops}
RAMP_S = {ramp}
# Each signal is a list of parts: start and length in s, and terms; a term is the product of an expression of the
# part's own t (or '' for 1) and of a constant plus sines of amplitude, rate in rad/s and phase in rad.
SIGNALS = [
{signals}]
# Which of them each channel plays.
COILS = [
{coil_signals}]
GROUP = 16


class Index(int):
    """A device's index; 0 too counts as one, which Session.open takes for none."""

    def __bool__(self):
        return True


def term_signal(shape, constant, tones):
    signal = Scalar(constant)
    for amplitude, rate, phase in tones:
        signal = signal + amplitude * Sine(Ramp(phase, rate))
    if not shape:
        return signal
    envelope = Expression(shape)
    if not math.isfinite(envelope.sample(0.0)):
        sys.exit(f"This Syntacts cannot read the expression {{shape}}")
    return envelope * signal


def part_signal(terms):
    signal = term_signal(*terms[0])
    for term in terms[1:]:
        signal = signal + term_signal(*term)
    return signal


def sequence(parts):
    """Signals (start, length, signal) one after the other; in groups, as a sequence asks all its parts at every t."""
    while len(parts) > GROUP:
        groups = [parts[k : k + GROUP] for k in range(0, len(parts), GROUP)]
        parts = [(group[0][0], group[-1][0] + group[-1][1] - group[0][0], sequence(group)) for group in groups]
    origin = parts[0][0]
    played = Sequence()
    for start, length, signal in parts:
        played.insert(Envelope(length) * signal, start - origin)
    return played


def coil_signal(parts):
    """What a coil plays, None for silence."""
    if not parts:
        return None
    if LOOPS and len(parts) == 1:
        return part_signal(parts[0][2])
    signals = [(start, length, part_signal(terms)) for start, length, terms in parts]
    if signals[0][0] > 0:
        signals.insert(0, (0.0, signals[0][0], Scalar(0.0)))
    played = sequence(signals)
    return Repeater(played + Envelope(SECONDS, 0.0), 1_000_000, 0.0) if LOOPS else played


def coil_signals():
    signals = [coil_signal(parts) for parts in SIGNALS]
    return [signals[k] for k in COILS]


def fade(session):
    """Down in steps, for a silence without a click, where the signals themselves do not end."""
    for step in range(32, -1, -1):
        for channel in range(len(COILS)):
            session.set_volume(channel, step / 32)
        time.sleep(RAMP_S / 32)


def main():
    session = Session()
    fitting = {{
        device.index: device
        for device in session.available_devices
        if device.max_channels >= len(COILS) and RATE_HZ in device.sample_rates
    }}
    if len(sys.argv) != 2 or not sys.argv[1].isdecimal() or int(sys.argv[1]) not in fitting:
        print(f"Devices with {{len(COILS)}} channels at {{RATE_HZ}} Hz:")
        for index, device in fitting.items():
            print(f"{{index:4}}  {{device.name}} ({{device.api_name}}), {{device.max_channels}} channels")
        return 2
    signals = coil_signals()
    fault = session.open(Index(sys.argv[1]), len(COILS), RATE_HZ)
    if fault:
        print(f"The device does not open (Syntacts error {{fault}}).")
        return 1
    try:
        for channel, signal in enumerate(signals):
            if signal is not None:
                session.play(channel, signal)
        while LOOPS:
            time.sleep(0.1)
        time.sleep(SECONDS + 0.5)
    except KeyboardInterrupt:
        pass
    finally:
        fade(session)
        session.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
'''
