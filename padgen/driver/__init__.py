"""Plan → what drives the pad: tones, states and tables."""

from padgen.driver.tables import drive_csv, drive_json, drive_rows
from padgen.driver.tones import State, coil_states

__all__ = ["State", "coil_states", "drive_csv", "drive_json", "drive_rows"]
