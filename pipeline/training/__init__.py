"""Training of the shipped person detectors on simulated scenes. Needs the extra ``[train]``."""
