"""Which camera took the pictures: calibration files, stated angles, known models, metadata."""
