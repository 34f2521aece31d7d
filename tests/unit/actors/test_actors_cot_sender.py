"""A server that is down first and comes up later; it is read back by PyTAK's own reader, and by lxml."""

from __future__ import annotations

import asyncio
import socket
import subprocess
from collections.abc import Awaitable, Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytak
import pytest
from lxml import etree

from actors.cot_sender import CotSender
from pipeline.errors import InputError


def events(count: int, note: str = "") -> dict[str, bytes]:
    return {
        f"u{k}": b'<?xml version="1.0" encoding="UTF-8"?>\n<event version="2.0" uid="u%d"><detail>%s</detail></event>'
        % (k, note.encode())
        for k in range(count)
    }


def free_port() -> int:
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return int(s.getsockname()[1])


class Server:
    """Reads events by PyTAK's RXWorker. most: closes a connection after so many."""

    def __init__(self, port: int, most: int | None = None, ssl: Any = None) -> None:
        self.port, self.most, self.ssl, self.read = port, most, ssl, []

    async def __aenter__(self) -> Server:
        self.server = await asyncio.start_server(self._client, "127.0.0.1", self.port, ssl=self.ssl)
        return self

    async def __aexit__(self, *_: object) -> None:
        self.server.close()

    async def _client(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        worker = pytak.RXWorker(asyncio.Queue(), {"TAK_PROTO": "0"}, reader)
        taken = 0
        while self.most is None or taken < self.most:
            data = await worker.readcot()
            if not data:
                break
            self.read.append(data)
            taken += 1
        writer.close()

    @property
    def uids(self) -> list[str]:
        return [str(etree.fromstring(data.strip()).get("uid")) for data in self.read]


async def while_sending(sender: CotSender, what: Callable[[], Awaitable[None]]) -> None:
    task = asyncio.ensure_future(sender.run())
    try:
        await what()
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


def test_events_wait_until_the_server_is_up() -> None:
    async def scenario() -> None:
        port, told = free_port(), []
        sender = CotSender(f"tcp://127.0.0.1:{port}", told.append)
        sender.put(events(5))

        async def what() -> None:
            await asyncio.sleep(0.5)
            assert (sender.sent, sender.waiting) == (0, 5)
            sender.put(events(2, "newer"))
            async with Server(port) as server:
                assert await sender.drained(10.0)
                assert server.uids == ["u2", "u3", "u4", "u0", "u1"]
                assert [b"newer" in data for data in server.read] == [False, False, False, True, True]

        await while_sending(sender, what)
        assert len(told) == 2
        assert "not reached" in told[0]
        assert "5 events wait" in told[0]
        assert "; 5 events wait" in told[1]

    asyncio.run(scenario())


def test_what_a_broken_connection_carried_is_sent_again() -> None:
    async def scenario() -> None:
        port = free_port()
        sender = CotSender(f"tcp://127.0.0.1:{port}", lambda _: None)

        async def what() -> None:
            async with Server(port, most=2) as first:
                sender.put(events(6))
                while len(first.read) < 2:
                    await asyncio.sleep(0.01)
            await asyncio.sleep(0.2)
            async with Server(port) as second:
                assert await sender.drained(10.0)
                while len(set(second.uids)) < 6:
                    await asyncio.sleep(0.01)
            assert set(second.uids) == {f"u{k}" for k in range(6)}

        await asyncio.wait_for(while_sending(sender, what), 20.0)

    asyncio.run(scenario())


def test_what_comes_later_goes_over_the_same_connection_at_once() -> None:
    async def scenario() -> None:
        port = free_port()
        sender = CotSender(f"tcp://127.0.0.1:{port}", lambda _: None)

        async def what() -> None:
            async with Server(port) as server:
                sender.put(events(1))
                assert await sender.drained(10.0)
                sender.put(events(3))
                begun = asyncio.get_running_loop().time()
                while len(server.read) < 4:
                    await asyncio.sleep(0.005)
                assert asyncio.get_running_loop().time() - begun < 1.0

        await while_sending(sender, what)

    asyncio.run(scenario())


def test_more_than_can_wait_drops_the_oldest_and_says_so() -> None:
    async def scenario() -> None:
        told: list[str] = []
        port = free_port()
        sender = CotSender(f"tcp://127.0.0.1:{port}", told.append, capacity=3)
        sender.put(events(5))
        assert (sender.waiting, sender.dropped) == (3, 2)
        assert "2 of the oldest events dropped, 2 in all" in told[0]

        async def what() -> None:
            async with Server(port) as server:
                assert await sender.drained(10.0)
                assert server.uids == ["u2", "u3", "u4"]

        await while_sending(sender, what)

    asyncio.run(scenario())


def test_udp_carries_an_event_a_datagram() -> None:
    async def scenario() -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
            receiver.bind(("127.0.0.1", 0))
            receiver.setblocking(False)
            sender = CotSender(f"udp://127.0.0.1:{receiver.getsockname()[1]}", lambda _: None)
            sender.put(events(3))

            async def what() -> None:
                assert await sender.drained(10.0)

            await while_sending(sender, what)
            read = [receiver.recv(65_536) for _ in range(3)]
        assert [etree.fromstring(data).get("uid") for data in read] == ["u0", "u1", "u2"]

    asyncio.run(scenario())


@pytest.mark.parametrize(
    "url", ["http://a:1", "tcp://a", "tcp://:80", "tcp://a:99999", "a:80", "tcp://me:secret@a:1", "tls://a:1"]
)
def test_another_address_is_refused(url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("PYTAK_TLS_CLIENT_CERT", raising=False)
    with pytest.raises(InputError):
        CotSender(url, print)


def test_tls_needs_a_certificate_that_the_server_takes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import ssl

    key, certificate = tmp_path / "key.pem", tmp_path / "cert.pem"
    subprocess.run(
        [
            "openssl",
            "req",
            "-x509",
            "-newkey",
            "rsa:2048",
            "-nodes",
            "-keyout",
            key,
            "-out",
            certificate,
            "-days",
            "1",
            "-days",
            "1",
            "-subj",
            "/CN=127.0.0.1",
            "-addext",
            "subjectAltName=IP:127.0.0.1",
        ],
        check=True,
        capture_output=True,
    )
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(certificate, key)
    context.load_verify_locations(certificate)
    context.verify_mode = ssl.CERT_REQUIRED
    for name, path in (("CERT", certificate), ("KEY", key), ("CAFILE", certificate)):
        monkeypatch.setenv(f"PYTAK_TLS_CLIENT_{name}", str(path))
    monkeypatch.setenv("PYTAK_TLS_SERVER_EXPECTED_HOSTNAME", "127.0.0.1")

    async def scenario() -> None:
        port = free_port()
        sender = CotSender(f"tls://127.0.0.1:{port}", lambda _: None)
        sender.put(events(3))

        async def what() -> None:
            async with Server(port, ssl=context) as server:
                assert await sender.drained(10.0)
                assert server.uids == ["u0", "u1", "u2"]

        await while_sending(sender, what)

    asyncio.run(scenario())
    monkeypatch.setenv("PYTAK_TLS_CLIENT_KEY", str(tmp_path / "none.pem"))
    with pytest.raises(InputError, match=r"none\.pem"):
        CotSender("tls://127.0.0.1:1", print)


def test_an_event_of_a_run_goes_through_unchanged(tmp_path: Path) -> None:
    import sys

    sys.path.append(str(Path(__file__).parents[1] / "outputs"))
    from run_folder import write_run

    from pipeline.outputs.exports.cot import events_of
    from pipeline.outputs.exports.view import read_run

    view = read_run(write_run(tmp_path / "run", "<script>"), datetime(2026, 5, 1, tzinfo=UTC))

    async def scenario() -> None:
        port = free_port()
        sender = CotSender(f"tcp://127.0.0.1:{port}", lambda _: None)
        sender.put(events_of(view))

        async def what() -> None:
            async with Server(port) as server:
                assert await sender.drained(10.0)
                points = [etree.fromstring(data.strip()).find("point") for data in server.read]
                for place, point in zip(view.places, points, strict=True):
                    assert float(point.get("lat")) == pytest.approx(place.latitude_deg, abs=1e-7)
                    assert float(point.get("lon")) == pytest.approx(place.longitude_deg, abs=1e-7)

        await while_sending(sender, what)

    asyncio.run(scenario())
