"""Contact that lasts: modes, forces and accelerations at one instant, and the impulses of simultaneous impacts."""
