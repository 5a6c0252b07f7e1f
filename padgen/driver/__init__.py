"""Plan → what drives the pad: tones, states and tables."""

from padgen.driver.states import State, coil_states
from padgen.driver.tables import drive_csv, drive_json, drive_rows

__all__ = ["State", "coil_states", "drive_csv", "drive_json", "drive_rows"]
