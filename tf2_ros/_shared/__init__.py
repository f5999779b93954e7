"""Share what one process receives with others: the ring, its owner, and the buffers attached to it."""
