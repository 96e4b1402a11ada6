"""What runs would show before any is recorded: of any strip, and of a fitted one for the time on the bench."""
