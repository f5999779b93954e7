"""Serialised messages in and out."""
