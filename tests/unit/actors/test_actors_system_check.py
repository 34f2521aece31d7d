from actors.system_check import PACKAGES, main, remedy


def test_a_missing_system_library_is_answered_with_its_package() -> None:
    message = "libexpat.so.1: cannot open shared object file: No such file or directory"
    assert remedy(message) == "libexpat.so.1 is missing (Debian: apt install libexpat1)"


def test_every_package_loads_here() -> None:
    assert len(PACKAGES) > 5
    assert main() == 0
