"""Receive what arrives on a listener's subscriptions, in a loop on rcl and its thread."""
