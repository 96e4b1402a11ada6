"""The recipes that the command line and the page share."""
