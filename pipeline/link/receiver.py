"""The far end of a link: takes the messages, says what it has read, and knows when a sender is silent."""

from __future__ import annotations

import socket
import struct
import threading
from collections.abc import Callable
from contextlib import suppress

from pipeline.clock import Clock
from pipeline.errors import ProtocolError
from pipeline.link import handshake
from pipeline.link.feedback import Feedback, Read, Restart, pack_feedback
from pipeline.link.framing import FrameReader
from pipeline.link.params import LinkParams
from pipeline.link.sockets import shut_down
from pipeline.logs import Log
from pipeline.messages import EndOfStream, Message, Packet, unpack

Address = tuple[str, int]
_READ_BYTES = 256 * 1024
#: restarts that a peer does not read; more means that it reads nothing at all
_MOST_UNSAID_BYTES = 64 * 1024
_LOG = Log("link")


class Receiver:
    """Listens; hands each message to on_message, in the order of its connection, on that connection's thread.

    on_message may block: then its sender is held up, since nothing is read meanwhile; one that must not hold up a
    link that others share drops instead and calls ``want_restart``. If it raises, the connection is closed and the
    exception kept in ``error``. A peer without the token, of another version, or with bytes that are no message loses
    its connection and is counted in ``rejected``. on_lost(name of the peer, reason): a connection that ended (a
    sender that has said all ends too: the messages tell), or is silent; on_back(name): it is heard again.
    """

    def __init__(
        self,
        host: str,
        on_message: Callable[[Message], None],
        *,
        token: bytes,
        port: int = 0,
        params: LinkParams | None = None,
        clock: Clock | None = None,
        on_lost: Callable[[str, str], None] = lambda name, reason: None,
        on_back: Callable[[str], None] = lambda name: None,
    ) -> None:
        self.rejected = 0
        self.error: Exception | None = None
        self._on_message, self._token = on_message, token
        self._params, self._clock = params or LinkParams(), clock or Clock()
        self._on_lost, self._on_back = on_lost, on_back
        self._lock = threading.Lock()
        self._peers: dict[threading.Thread, _Peer] = {}
        self._origins: dict[tuple[str, str], _Peer] = {}
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        self._listener = socket.create_server((host, port), family=family)
        self.address: Address = self._listener.getsockname()[:2]
        self._closed = threading.Event()
        for target, name in ((self._accept, "accept"), (self._tick, "tick")):
            threading.Thread(target=target, name=f"link {name} {self.address[1]}", daemon=True).start()

    def want_restart(self, stream: str, detector: str) -> None:
        """Ask whoever sent the substream last to begin its encoder anew: a packet of it was not taken."""
        with self._lock:
            origin = self._origins.get((stream, detector))
        if origin is not None:
            origin.say(Restart(stream, detector))

    def close(self) -> None:
        """Stop listening, close all connections; a message in on_message is waited for, at most a second."""
        with self._lock:
            self._closed.set()
            peers = dict(self._peers)
        for endpoint in (self._listener, *(peer.socket for peer in peers.values())):
            shut_down(endpoint)
        self._listener.close()
        for thread in peers:
            if thread is not threading.current_thread():
                thread.join(timeout=1.0)

    def _accept(self) -> None:
        while True:
            try:
                connection, _ = self._listener.accept()
            except OSError:  # close()
                return
            peer = _Peer(connection, self._params, self._clock)
            thread = threading.Thread(target=self._serve, args=(peer,), name="link receive", daemon=True)
            with self._lock:
                if self._closed.is_set():
                    connection.close()
                    return
                self._peers[thread] = peer
            thread.start()

    def _serve(self, peer: _Peer) -> None:
        reason = "closed by the sender"
        try:
            peer.greet(self._token)
            self._take(peer)
        except ProtocolError as error:
            reason = str(error)
            with self._lock:
                self.rejected += 1
        except BlockingIOError:  # the limit of receive
            reason = f"silent for {self._params.broken_s:g} s"
        except OSError as error:  # the peer is gone, or close(); what is missing is for the mission to notice
            reason = error.strerror or str(error)
        finally:
            with self._lock:
                self._peers.pop(threading.current_thread(), None)
            peer.socket.close()
        _LOG.event("connection ends", peer=peer.name, reason=reason)
        if not self._closed.is_set():
            self._on_lost(peer.name, reason)

    def _take(self, peer: _Peer) -> None:
        reader = FrameReader()
        while data := peer.receive():
            for message in map(unpack, reader.feed(data)):
                if isinstance(message, Packet | EndOfStream):
                    self._origins[message.stream, message.detector] = peer
                if not self._deliver(peer, message):
                    return

    def _deliver(self, peer: _Peer, message: Message) -> bool:
        peer.delivering = True
        try:
            self._on_message(message)
        except Exception as error:
            self.error = error
            return False
        finally:
            peer.delivering = False
        return True

    def _tick(self) -> None:
        """Beside the threads that read: one of these that waits for on_message must not look dead."""
        while not self._closed.wait(self._params.ack_s):
            with self._lock:
                peers = list(self._peers.values())
            for peer in peers:
                peer.acknowledge(least_s=0.0)
                self._notice(peer)

    def _notice(self, peer: _Peer) -> None:
        silent = peer.is_silent()
        if silent == peer.was_silent:
            return
        peer.was_silent = silent
        _LOG.event("sender silent" if silent else "sender heard again", peer=peer.name)
        if silent:
            self._on_lost(peer.name, f"silent for {self._params.silence_s:g} s")
        else:
            self._on_back(peer.name)


class _Peer:
    """One connection, as its receiver sees it."""

    def __init__(self, connection: socket.socket, params: LinkParams, clock: Clock) -> None:
        self.socket, self.name = connection, "?"
        self.delivering, self.was_silent = False, False
        self._params, self._clock = params, clock
        self._greeted = False
        self._heard_s = self._said_s = clock.monotonic_s()
        self._read = Read(0, self._heard_s)
        self._acknowledged = 0
        self._unsaid = b""
        self._saying = threading.Lock()

    def greet(self, token: bytes) -> None:
        """The handshake; after it the peer is spoken to."""
        name = handshake.accept(self.socket, token, self._params.connect_s)
        self.name = name or "?"
        # not settimeout, which would make sends wait too
        limit = struct.pack("ll", int(self._params.broken_s), round(self._params.broken_s % 1.0 * 1e6))
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, limit)
        self._heard_s = self._clock.monotonic_s()
        self._greeted = True

    def receive(self) -> bytes:
        """The next bytes; none at the end. Raises BlockingIOError after broken_s without any."""
        data = self.socket.recv(_READ_BYTES)
        self._heard_s = self._clock.monotonic_s()
        self._read = Read(self._read.total_bytes + len(data), self._heard_s)
        if self._read.total_bytes - self._acknowledged >= self._params.ack_bytes:
            self.acknowledge(least_s=self._params.ack_s / 5.0)
        return data

    def is_silent(self) -> bool:
        """Whether nothing came for silence_s, though it is waited for."""
        waited_s = self._clock.monotonic_s() - self._heard_s
        return self._greeted and not self.delivering and waited_s > self._params.silence_s

    def acknowledge(self, least_s: float) -> None:
        """Say what was read, if it is news or a heartbeat is due, but not within least_s of the last time."""
        now_s, read = self._clock.monotonic_s(), self._read
        due = read.total_bytes > self._acknowledged or now_s - self._said_s >= self._params.heartbeat_s
        if not self._greeted or not due or now_s - self._said_s < least_s:
            return
        self._said_s, self._acknowledged = now_s, read.total_bytes
        self.say(read)

    def say(self, feedback: Feedback) -> None:
        """Send a record without waiting; a peer that does not read does not stop us."""
        with self._saying, suppress(OSError):  # gone: the reading thread notices
            if isinstance(feedback, Restart) or not self._unsaid:
                self._unsaid += pack_feedback(feedback)
            if len(self._unsaid) > _MOST_UNSAID_BYTES:
                shut_down(self.socket)
                return
            with suppress(BlockingIOError):
                self._unsaid = self._unsaid[self.socket.send(self._unsaid, socket.MSG_DONTWAIT) :]
