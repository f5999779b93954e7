"""What the engine leaves to Python: messages, errors, listings, explanations, log lines, parts of pickles."""
