"""Pads as a slicer lays them: measure a pad in G-code, and judge its beams, resonances and settings."""
