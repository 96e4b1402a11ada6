"""The parts of choosing between models: blocks, noise, held-out predictions, paired differences."""
