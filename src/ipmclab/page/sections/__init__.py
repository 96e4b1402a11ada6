"""The sections of the page, one a file: each has ``build(context)``, which fills the page that is being made."""
