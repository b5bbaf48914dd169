"""What scripts/bench and scripts/bench-guard are made of. Python's standard library only."""
