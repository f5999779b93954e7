"""What the engine leaves to Python: classes of messages, errors, listings, log lines, parts of pickles."""
