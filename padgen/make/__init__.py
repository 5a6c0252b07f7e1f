"""Spec → Plan → Pad: which model plans, plans tuned to the printed solid, a pad and its folder."""
