"""Player of the WAV files of `padgen drive` through a sound card with a channel for each coil."""

from typing import TYPE_CHECKING, Any

from padgen.core.errors import plain
from padgen.driver.players import WavJob

if TYPE_CHECKING:
    from padgen.driver.sound_card import Sounded

__all__ = ["ABOUT", "ADDRESS", "PLAYS", "outcome", "play"]

PLAYS = "wav"
ADDRESS = "[DEVICE]"
ABOUT = "sound card, by name or number (default: the system's)"


def play(job: WavJob) -> "Sounded":
    """Play the file; errors are those of `padgen.play_wav`."""
    from padgen.driver.sound_card import play_wave

    return play_wave(job.path, job.address, job.repeat, lambda chosen: job.progress(f"playing on {chosen.name}"))


def outcome(played: "Sounded") -> tuple[str, dict[str, Any]]:
    """Return a sentence on how long the file played and how many blocks came too late, and these figures."""
    late = f"; gaps are heard where the computer was too late: {played.missed}" if played.missed else ""
    figures = {"device": played.device.name, "seconds": played.seconds, "late_blocks": played.missed}
    return f"played {played.seconds:.1f} s on {plain(played.device.name)}{late}", figures
