from pipeline.experiments.detector_accuracy import detector_accuracy


def test_half_the_accuracy_halves_what_single_looks_add(small_mission, tmp_path):
    found = detector_accuracy(small_mission, tmp_path, lambda *_: None)
    full, half, looks = (measure.ours for measure in found.measures[:3])
    assert looks > 0
    # the clamp takes a little from the greater one
    assert 0.5 + (full - 0.5) / 2.0 - 1e-3 <= half <= 0.5 + (full - 0.5) / 2.0 + 0.02
    assert full > 0.8
