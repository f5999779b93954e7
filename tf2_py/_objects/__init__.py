"""Python objects in and out: messages, times, errors, listings, log lines."""
