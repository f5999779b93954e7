"""Receive what arrives on the subscriptions of listeners."""
