"""What a listener's subscriptions receive: a loop on rcl, and its thread."""
