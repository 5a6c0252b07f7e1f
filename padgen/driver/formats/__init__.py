"""Files that other programs and machines take: WAV, MPEG haptics, Syntacts, C with its firmware."""
