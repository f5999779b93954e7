"""Long searches for faults, each started by a make target: see docs/development/reliability.md."""
