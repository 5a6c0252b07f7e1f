"""All that drives a planned pad: tones, on/off states, tables and waveforms, and the devices that play them."""
