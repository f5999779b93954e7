"""Long searches for faults, each started by a make target; docs/reliability.md describes what they found."""
