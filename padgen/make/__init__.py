"""Plan a spec by the right model, tune plans to the printed solid, and build a pad with its folder."""
