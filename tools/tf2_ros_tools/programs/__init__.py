"""The programs: each module is one, with its command line and its work."""
