import pickle

from pipeline.errors import InputError, RunFailedError, failure


def test_an_error_of_ours_travels_as_it_is() -> None:
    error = pickle.loads(pickle.dumps(failure(InputError("v.mp4", "a damaged picture 7", "a whole video"))))
    assert isinstance(error, InputError)
    assert (str(error), error.exit_code) == ("v.mp4: found a damaged picture 7; expected a whole video", 2)


def test_any_other_error_says_where_it_happened() -> None:
    try:
        int("seven")
    except ValueError as caught:
        error = pickle.loads(pickle.dumps(failure(caught)))
    assert isinstance(error, RunFailedError)
    assert error.exit_code == 1
    assert "test_errors.py" in str(error)
