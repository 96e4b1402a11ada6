"""An experiment: its file, its plan, its steps, and how it is carried out."""
