"""Environmental chambers: what every one of them can do, and one driver a file."""
