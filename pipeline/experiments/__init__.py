"""The paper's experiments on simulated missions with real detectors."""
