"""What other programs and read-only places must not do to a run."""

import os
import stat
from pathlib import Path

import pytest

from actors import surroundings
from actors.metrics import RunCollector, serve
from pipeline.errors import InputError


def test_the_databases_of_other_programs_are_not_used() -> None:
    environment = {"PROJ_LIB": "/opt/other/proj", "PROJ_DATA": "/x", "GDAL_DATA": "/y", "HOME": "/root"}
    surroundings.settle(environment)
    assert environment == {"HOME": "/root"}


def test_a_read_only_installation_keeps_its_caches_where_only_we_can_write(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(surroundings, "_writable", lambda _: False)
    environment: dict[str, str] = {}
    surroundings.settle(environment)
    for name in ("NUMBA_CACHE_DIR", "MPLCONFIGDIR"):
        state = os.stat(environment[name])
        assert state.st_uid == os.getuid()
        assert not stat.S_IMODE(state.st_mode) & 0o077


def test_a_folder_that_others_can_write_is_not_taken_for_the_cache(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    planted = tmp_path / f"searchlight-numba-{os.getuid()}"
    planted.mkdir()
    planted.chmod(0o777)
    assert surroundings._own_temporary_folder("numba") != planted


def test_a_metrics_port_in_use_is_one_line() -> None:
    server = serve(RunCollector(), 0)
    try:
        with pytest.raises(InputError, match="cannot be served"):
            serve(RunCollector(), server.server_port)
    finally:
        server.server_close()


@pytest.mark.parametrize(("port", "host"), [(70000, "127.0.0.1"), (0, "192.0.2.1"), (0, "no such host")])
def test_a_port_or_interface_that_cannot_be_had_is_one_line(port: int, host: str) -> None:
    with pytest.raises(InputError, match="cannot be served"):
        serve(RunCollector(), port, host)
