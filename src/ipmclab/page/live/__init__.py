"""What the bench does now: a client of the recorder's process, and what browsers are told of it."""
