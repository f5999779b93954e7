"""Python objects read and made: messages, times, arrays, errors, listings, log lines."""
