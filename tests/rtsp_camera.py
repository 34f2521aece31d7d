"""A camera that speaks RTSP, with RTCP sender reports, which tstrans' server leaves out. One client at a time, TCP."""

from __future__ import annotations

import base64
import socket
import struct
import threading
import time
from collections.abc import Sequence

_NTP_1970 = 2_208_988_800
_SSRC = 0x51EA


class RtspCamera:
    """Sends encoded pictures (Annex B, one slice each), over and over, rate_hz a second, to whoever comes.

    clock_off_s: what its sender reports are ahead of the time; None: it sends none. password: ``user:password`` that it
    wants (Basic). port: 0 for any free one. Made with ``with``.
    """

    def __init__(
        self,
        pictures: Sequence[bytes],
        rate_hz: float,
        clock_off_s: float | None = 0.0,
        password: str | None = None,
        port: int = 0,
    ) -> None:
        self._pictures, self._rate_hz, self._off_s, self._password = pictures, rate_hz, clock_off_s, password
        self._listener = socket.create_server(("127.0.0.1", port))
        self.port = self._listener.getsockname()[1]
        self._stop = threading.Event()
        threading.Thread(target=self._serve, daemon=True).start()

    def __enter__(self) -> RtspCamera:
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._listener.close()

    def _serve(self) -> None:
        while not self._stop.is_set():
            try:
                client, _ = self._listener.accept()
            except OSError:
                return
            with client:
                try:
                    self._talk(client)
                except OSError:
                    continue

    def _talk(self, client: socket.socket) -> None:
        requests = client.makefile("rb")
        while True:
            first = requests.readline().decode()
            if not first:
                return
            head = dict(
                line.decode().strip().lower().split(":", 1) for line in iter(requests.readline, b"\r\n")
            )
            method = first.split()[0]
            answer = f"RTSP/1.0 200 OK\r\nCSeq:{head['cseq']}\r\nSession: 1\r\n"
            if self._password is not None and not self._is_let_in(head):
                challenge = 'WWW-Authenticate: Basic realm="camera"\r\n'
                answer = f"RTSP/1.0 401 Unauthorized\r\nCSeq:{head['cseq']}\r\n{challenge}"
            elif method == "DESCRIBE":
                body = "v=0\r\ns=camera\r\nt=0 0\r\nm=video 0 RTP/AVP 96\r\na=rtpmap:96 H264/90000\r\n"
                body += f"a=fmtp:96 packetization-mode=1;sprop-parameter-sets={self._parameters()}\r\na=control:v\r\n"
                answer += f"Content-Type: application/sdp\r\nContent-Length: {len(body)}\r\n\r\n{body}"
                client.sendall(answer.encode())
                continue
            elif method == "SETUP":
                answer += "Transport: RTP/AVP/TCP;unicast;interleaved=0-1\r\n"
            client.sendall(f"{answer}\r\n".encode())
            if method == "PLAY":
                self._play(client)
                return

    def _is_let_in(self, head: dict[str, str]) -> bool:
        wanted = base64.b64encode(str(self._password).encode()).decode().lower()
        return head.get("authorization", "").strip() == f"basic {wanted}"

    def _parameters(self) -> str:
        sets = [unit for unit in _units(self._pictures[0]) if unit[0] & 0x1F in (7, 8)]
        return ",".join(base64.b64encode(unit).decode() for unit in sets)

    def _play(self, client: socket.socket) -> None:
        begun_s, sequence, number = time.monotonic(), 0, 0
        begun_utc_s = time.time()
        while not self._stop.is_set():
            at_s = number / self._rate_hz
            ticks = round(at_s * 90_000) + 12_345
            if self._off_s is not None and number % 5 == 0:
                ntp_s = begun_utc_s + at_s + self._off_s + _NTP_1970
                fraction = int((ntp_s % 1.0) * 2**32)
                report = struct.pack(
                    ">BBHIIIIII", 0x80, 200, 6, _SSRC, int(ntp_s), fraction, ticks, number, 0
                )
                client.sendall(struct.pack(">cBH", b"$", 1, len(report)) + report)
            units = _units(self._pictures[number % len(self._pictures)])
            for k, unit in enumerate(units):
                last = 0x80 if k == len(units) - 1 else 0
                packet = struct.pack(">BBHII", 0x80, last | 96, sequence & 0xFFFF, ticks, _SSRC) + unit
                client.sendall(struct.pack(">cBH", b"$", 0, len(packet)) + packet)
                sequence += 1
            number += 1
            self._stop.wait(max(0.0, begun_s + number / self._rate_hz - time.monotonic()))


def _units(data: bytes) -> list[bytes]:
    """The NAL units of Annex B."""
    return [unit.rstrip(b"\0") for unit in data.split(b"\0\0\1") if unit.strip(b"\0")]
