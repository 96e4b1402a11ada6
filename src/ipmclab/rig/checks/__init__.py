"""Whether a rig is fit: looked at before a run, and proven on its hardware."""
