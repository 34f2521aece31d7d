"""The far end of a link: takes the messages, says what it has read, and knows when a sender is silent."""

from __future__ import annotations

import socket
import struct
import threading
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import suppress

from pipeline.clock import Clock
from pipeline.errors import ProtocolError
from pipeline.link.door import Door, Guest
from pipeline.link.feedback import Feedback, Read, Restart, pack_feedback
from pipeline.link.handshake import Greeting
from pipeline.link.keys import Endpoint, KeyPair, fingerprint
from pipeline.link.params import LinkParams
from pipeline.link.sockets import shut_down
from pipeline.logs import Log
from pipeline.messages import EndOfStream, Message, Packet, unpack

_READ_BYTES = 256 * 1024
#: restarts that a peer does not read; more means that it reads nothing at all
_MOST_UNSAID_BYTES = 64 * 1024
#: so many times ack_bytes are acknowledged at once: a fast sender must not wait for the time
_MUCH = 32
#: connections that the kernel holds until they are taken
_BACKLOG = 1024
#: why connections are not taken, or ended
REJECTED = (
    "bad_length",
    "crowded",
    "cut",
    "not_a_message",
    "not_authentic",
    "out_of_range",
    "revoked",
    "silent",
    "too_many",
    "unknown_key",
    "version",
    "went_away",
)
_LOG = Log("link")


class Receiver:
    """Listens; hands each message to on_message, in the order of its connection, on that connection's thread.

    on_message may block: then its sender is held up, since nothing is read meanwhile; one that must not hold up a
    link that others share drops instead and calls ``want_restart``. If it raises, the connection is closed and the
    exception kept in ``error``. keys: who listens. Only peers whose public key is in peers (see ``accept_only``) are
    heard; one without, of another version, or with bytes that are no message of its own loses its connection
    and is counted in ``rejected``, by reason. refuse(name of the peer, message): why a message is not taken from it,
    one of few words, or None; it is counted in ``refused``, and the connection stays. on_lost(name of the peer,
    reason): a connection that ended (a sender that has said all ends too: the messages tell), or is silent;
    on_back(name): it is heard again.
    """

    def __init__(
        self,
        host: str,
        on_message: Callable[[Message], None],
        *,
        keys: KeyPair,
        peers: Mapping[bytes, str] | None = None,
        port: int = 0,
        params: LinkParams | None = None,
        clock: Clock | None = None,
        refuse: Callable[[str, Message], str | None] = lambda peer, message: None,
        on_lost: Callable[[str, str], None] = lambda name, reason: None,
        on_back: Callable[[str], None] = lambda name: None,
    ) -> None:
        """peers: names by public key, 32 bytes."""
        self.error: Exception | None = None
        self._rejected: Counter[str] = Counter()
        self._refused: Counter[str] = Counter()
        self._on_message, self._why_refuse, self._keys = on_message, refuse, keys
        self._params, self._clock = params or LinkParams(), clock or Clock()
        self._on_lost, self._on_back = on_lost, on_back
        self._lock = threading.Lock()
        self._known, self._revoked = dict(peers or {}), set[bytes]()
        self._peers: dict[threading.Thread, _Peer] = {}
        self._origins: dict[tuple[str, str], _Peer] = {}
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        self._listener = socket.create_server((host, port), family=family, backlog=_BACKLOG)
        #: where it listens, and its public key
        where = self._listener.getsockname()
        self.endpoint = Endpoint(where[0], where[1], keys.public)
        self._closed = threading.Event()
        door = Door(self._listener, self._params, self._greeting, self._welcome, self._count)
        for target, name in ((lambda: door.run(self._closed.is_set), "door"), (self._tick, "tick")):
            port = self.endpoint.port
            threading.Thread(target=target, name=f"link {name} {port}", daemon=True).start()

    @property
    def rejected(self) -> dict[str, int]:
        """Connections that were not taken or were ended, by reason."""
        with self._lock:
            return dict(self._rejected)

    @property
    def refused(self) -> dict[str, int]:
        """Messages that were not taken, by reason."""
        with self._lock:
            return dict(self._refused)

    def accept_only(self, peers: Mapping[bytes, str]) -> None:
        """From now on these peers, names by public key, and no others: who is not among them any more is cut off."""
        with self._lock:
            self._revoked = (self._revoked | self._known.keys()) - peers.keys()
            self._known = dict(peers)
            gone = [peer for peer in self._peers.values() if peer.key not in self._known]
        for peer in gone:
            _LOG.warning("key revoked", peer=peer.name, key=fingerprint(peer.key))
            shut_down(peer.socket)

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

    def _greeting(self) -> Greeting:
        return Greeting(self._keys, self._name_of)

    def _name_of(self, key: bytes) -> str | None:
        """Raises ProtocolError for one who was known, and is not any more."""
        with self._lock:
            if key in self._revoked:
                raise ProtocolError("a key that was revoked", "revoked")
            return self._known.get(key)

    def _count(self, reason: str, text: str) -> None:
        with self._lock:
            self._rejected[reason] += 1
        _LOG.event("connection refused", reason=reason, text=text)
        if not self._closed.is_set():
            self._on_lost("?", text)

    def _welcome(self, guest: Guest) -> None:
        """Serve one that has proven whose it is."""
        peer = _Peer(guest, self._params, self._clock)
        thread = threading.Thread(target=self._serve, args=(peer,), name="link receive", daemon=True)
        with self._lock:
            refusal = None if self._closed.is_set() else self._refusal(peer)
            if refusal is None and not self._closed.is_set():
                try:
                    thread.start()
                    self._peers[thread] = peer
                    return
                except RuntimeError:  # the system has no room for another thread
                    refusal = "crowded", "no thread for another connection"
        peer.socket.close()
        if refusal is not None:
            self._count(*refusal)

    def _refusal(self, peer: _Peer) -> tuple[str, str] | None:
        """Why one that has proven whose it is is not served, in a word and in words."""
        if peer.key not in self._known:
            return "revoked", "a key that was revoked"
        if sum(other.key == peer.key for other in self._peers.values()) >= self._params.most_connections:
            return "too_many", f"{peer.name} has {self._params.most_connections} connections"
        return None

    def _serve(self, peer: _Peer) -> None:
        reason = "closed by the sender"
        try:
            self._take(peer)
        except ProtocolError as error:
            reason = str(error)
            with self._lock:
                self._rejected[error.reason] += 1
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
        while (sealed := peer.receive()) is not None:
            for message in map(unpack, sealed):
                if (reason := self._why_refuse(peer.name, message)) is not None:
                    with self._lock:
                        self._refused[reason] += 1
                    continue
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

    def __init__(self, guest: Guest, params: LinkParams, clock: Clock) -> None:
        self.socket, self.name, self.key = guest.socket, guest.name, guest.key
        self.delivering, self.was_silent = False, False
        self._session, self._params, self._clock = guest.session, params, clock
        self._heard_s = self._said_s = clock.monotonic_s()
        self._read = Read(0, self._heard_s)
        self._acknowledged = 0
        self._unsaid = b""
        self._saying = threading.Lock()
        # not settimeout, which would make sends wait too
        limit = struct.pack("ll", int(params.broken_s), round(params.broken_s % 1.0 * 1e6))
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, limit)

    def receive(self) -> list[bytes] | None:
        """The next messages, maybe none yet; None at the end. Raises BlockingIOError after broken_s without a byte,
        ProtocolError for bytes that the peer did not send, or an end in the middle of a record.
        """
        data = self.socket.recv(_READ_BYTES)
        if not data:
            if self._session.reader.is_cut:
                raise ProtocolError("a connection that ended within a record", "cut")
            return None
        self._heard_s = self._clock.monotonic_s()
        self._read = Read(self._read.total_bytes + len(data), self._heard_s)
        messages = self._session.reader.feed(data)
        unsaid_bytes = self._read.total_bytes - self._acknowledged
        if unsaid_bytes >= self._params.ack_bytes:
            much = unsaid_bytes >= _MUCH * self._params.ack_bytes
            self.acknowledge(least_s=0.0 if much else self._params.ack_s / 5.0)
        return messages

    def is_silent(self) -> bool:
        """Whether nothing came for silence_s, though it is waited for."""
        waited_s = self._clock.monotonic_s() - self._heard_s
        return not self.delivering and waited_s > self._params.silence_s

    def acknowledge(self, least_s: float) -> None:
        """Say what was read, if it is news or a heartbeat is due, but not within least_s of the last time."""
        now_s, read = self._clock.monotonic_s(), self._read
        due = read.total_bytes > self._acknowledged or now_s - self._said_s >= self._params.heartbeat_s
        if not due or now_s - self._said_s < least_s:
            return
        self._said_s, self._acknowledged = now_s, read.total_bytes
        self.say(read)

    def say(self, feedback: Feedback) -> None:
        """Send a record without waiting; a peer that does not read does not stop us."""
        with self._saying, suppress(OSError):  # gone: the reading thread notices
            if isinstance(feedback, Restart) or not self._unsaid:
                self._unsaid += self._session.writer.seal(pack_feedback(feedback))
            if len(self._unsaid) > _MOST_UNSAID_BYTES:
                shut_down(self.socket)
                return
            with suppress(BlockingIOError):
                self._unsaid = self._unsaid[self.socket.send(self._unsaid, socket.MSG_DONTWAIT) :]
