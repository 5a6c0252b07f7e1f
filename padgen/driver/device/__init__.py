"""Playing on real devices: the serial protocol of the firmware, and sound cards."""
