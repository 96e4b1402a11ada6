"""What the bench does now: a client of the recorder's process, and what is sent of it to browsers."""
