"""Plan a spec by the beam model or by finite elements, tune beams to the printed solid, and write a pad's folder."""
