"""Long searches for faults, each started by a make target; docs/reliability.md tells what they found."""
