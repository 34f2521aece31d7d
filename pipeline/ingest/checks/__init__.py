"""Checks that know what a value means: each gives findings, with the measurement behind them; none changes a value."""
