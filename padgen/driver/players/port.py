"""Player of frames on a microcontroller with padgen's firmware, over a serial port."""

from typing import TYPE_CHECKING, Any

from padgen.core.errors import plain
from padgen.driver.players import FramesJob

if TYPE_CHECKING:
    from padgen.driver.serial_line import Played

__all__ = ["ABOUT", "ADDRESS", "PLAYS", "outcome", "play"]

PLAYS = "frames"
ADDRESS = "PORT"
ABOUT = "serial port of the microcontroller, as /dev/ttyACM0 or COM3"


def play(job: FramesJob) -> "Played":
    """Show frames, each once and in order; errors are those of `padgen.play`."""
    from padgen.driver.serial_line import play_frames

    return play_frames(
        job.address,
        job.plan,
        job.levels,
        job.seconds,
        tuning=job.tuning,
        baud=job.baud,
        on_shown=job.on_shown,
    )


def outcome(played: "Played") -> tuple[str, dict[str, Any]]:
    """Return a sentence on frames shown, messages sent again and voltage reduced for heat, and these figures."""
    count = "1 frame" if played.frames == 1 else f"{played.frames} frames"
    parts = [f"showed {count} in {played.seconds:.1f} s on {plain(played.port)}"]
    if played.resent:
        parts.append(f"{played.resent} messages were lost on the line and sent again")
    if played.given < 1:
        parts.append(f"coils were as warm as they bear, and got down to {played.given:.0%} of their voltage")
    figures = {name: getattr(played, name) for name in ("port", "frames", "resent", "seconds", "given")}
    return "; ".join(parts), figures
