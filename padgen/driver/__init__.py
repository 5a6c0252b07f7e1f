"""Plan → what drives the pad: tones, states, tables, waveforms, and the devices that play them."""
