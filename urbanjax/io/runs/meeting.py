"""Where processes that share a run meet: process 0 at an address, the others come; nobody begins before all are there.

JAX ends a process with its own abort where another never comes or a port is taken, so they meet here first.
"""

import contextlib
import json
import os
import socket
import time
from collections.abc import Mapping
from typing import Any

from urbanjax.types import ConfigError, ProcessError
from urbanjax.types.unread import changed

Message = tuple[str, str]  # its kind, and a text
HELLO, WELCOME, REFUSED = "hello", "welcome", "refused"
LONGEST = 1 << 20  # bytes of a message: whoever sends more is none of us
ANSWER = 5.0  # s within which whoever has come says who he is
PAUSE = 0.2  # s between two tries
SHOWN = 3  # keys in a message
# A machine that vanishes says nothing: the kernel asks after 5 s of silence, and gives up after three more of them.
KEEPALIVE = {"TCP_KEEPIDLE": 5, "TCP_KEEPINTVL": 5, "TCP_KEEPCNT": 3}


class Wire:
    """Messages from and to one other process. It breaks when that process ends, however it ends."""

    def __init__(self, connection: socket.socket) -> None:
        """A wire over a connection, which it owns."""
        self.connection, self._rest = connection, b""

    def send(self, kind: str, text: str = "") -> None:
        """Send a message. Args: kind; text. Raises OSError where the other process has ended."""
        self.connection.sendall(json.dumps([kind, text]).encode() + b"\n")

    def receive(self, timeout: float | None = None) -> list[Message]:
        """What has come, maybe half a message, which is none yet.

        Args: timeout in seconds, None to wait for ever. Raises TimeoutError, EOFError where the other process is gone,
        and ValueError for what is no message.
        """
        self.connection.settimeout(timeout)
        try:
            data = self.connection.recv(1 << 16)
        except ConnectionError as error:
            raise EOFError from error
        finally:
            self.connection.settimeout(None)
        if not data:
            raise EOFError
        *lines, self._rest = (self._rest + data).split(b"\n")
        if len(self._rest) > LONGEST:
            raise ValueError("a message without end")
        return [_message(line) for line in lines]

    def first(self, timeout: float) -> Message:
        """The first message; whoever sends it waits for an answer. Args: timeout in seconds. Raises as `receive`."""
        until = time.monotonic() + timeout
        come: list[Message] = []
        while not come:
            come = self.receive(max(until - time.monotonic(), 1e-3))
        return come[0]

    def close(self) -> None:
        """Hang up."""
        self.connection.close()


def address(coordinator: str) -> tuple[str, int]:
    """Host and port. Args: coordinator, HOST:PORT. Raises ConfigError for anything else."""
    host, _, port = coordinator.rpartition(":")
    if not host or not port.isdecimal() or not 0 < int(port) < 1 << 16:
        raise ConfigError(f"coordinator={coordinator}: give HOST:PORT of process 0, such as 127.0.0.1:12345")
    return host.strip("[]"), int(port)


def is_local(host: str) -> bool:
    """Whether only processes of this machine can come there. Args: host, as typed."""
    return host in ("localhost", "::1") or host.startswith("127.")


def host(coordinator: str, processes: int, *, about: Mapping[str, Any], patience: float) -> dict[int, Wire]:
    """The wires to all other processes by number, for process 0, once all have come and are about the same.

    Args: coordinator, HOST:PORT; processes, how many there are; about, plain values that must be the same for all;
    patience in seconds. Raises ConfigError for a port that is taken and for a process that differs or does not come.
    """
    wires: dict[int, Wire] = {}
    until = time.monotonic() + patience
    try:
        with _server(coordinator) as server:
            while missing := sorted(set(range(1, processes)) - set(wires)):
                server.settimeout(max(until - time.monotonic(), 1e-3))
                try:
                    wire = _wire(server.accept()[0])
                except TimeoutError as error:
                    raise ConfigError(_absent(missing, coordinator, patience)) from error
                _admit(wire, wires, about)
        for wire in wires.values():
            wire.send(WELCOME)
    except BaseException as error:
        for wire in wires.values():
            _refuse(wire, f"process 0 has not begun: {error}")
        raise
    return wires


def join(coordinator: str, process: int, *, about: Mapping[str, Any], patience: float) -> dict[int, Wire]:
    """The wire to process 0, by its number, once all have come.

    Args: coordinator, HOST:PORT of process 0; process, the number of this one; about, as for `host`; patience in
    seconds. Raises ConfigError where nobody answers there or something else does, ProcessError where process 0 refuses
    or ends.
    """
    until = time.monotonic() + patience
    wire = _wire(_connection(coordinator, until, patience))
    try:
        wire.send(HELLO, json.dumps({"process": process, **about}))
        kind, text = wire.first(patience + ANSWER)  # process 0 is the one that loses patience
        if kind != WELCOME:
            raise ProcessError(text)
    except BaseException as error:
        wire.close()
        if isinstance(error, TimeoutError | ValueError):
            raise ConfigError(f"coordinator={coordinator}: what answers there is not process 0") from error
        if isinstance(error, EOFError | OSError):
            raise ProcessError("process 0 has ended without a word before all had come") from error
        raise
    return {0: wire}


def _wire(connection: socket.socket) -> Wire:
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    for name, value in KEEPALIVE.items():
        if hasattr(socket, name):  # not every system has all of them
            connection.setsockopt(socket.IPPROTO_TCP, getattr(socket, name), value)
    return Wire(connection)


def _server(coordinator: str) -> socket.socket:
    name, port = address(coordinator)
    try:
        if is_local(name):
            return socket.create_server((name, port), family=socket.AF_INET6 if ":" in name else socket.AF_INET)
        # The name of a machine may stand for its loopback at home: others reach it on every interface only.
        if socket.has_dualstack_ipv6():
            return socket.create_server(("", port), family=socket.AF_INET6, dualstack_ipv6=True)
        return socket.create_server(("", port))
    except OSError as error:
        told = os.strerror(error.errno) if error.errno and error.errno > 0 else error
        raise ConfigError(
            f"coordinator={coordinator}: process 0 cannot listen there ({told}); give a free port"
        ) from error


def _connection(coordinator: str, until: float, patience: float) -> socket.socket:
    name, port = address(coordinator)
    while True:
        try:
            found = socket.create_connection((name, port), timeout=max(until - time.monotonic(), PAUSE))
        except socket.gaierror as error:
            raise ConfigError(f"coordinator={coordinator}: there is no host '{name}' ({error.strerror})") from error
        except OSError as error:
            if time.monotonic() > until:
                raise ConfigError(_absent([0], coordinator, patience)) from error
        else:
            if found.getsockname() != found.getpeername():
                return found
            found.close()  # a socket of this machine that tries a free port for long may happen to meet itself
        time.sleep(PAUSE)


def _admit(wire: Wire, wires: dict[int, Wire], about: Mapping[str, Any]) -> None:
    """Add a process that has come, or turn away what is none. Raises ConfigError for one that does not fit."""
    try:
        kind, text = wire.first(ANSWER)
        theirs = json.loads(text) if kind == HELLO else {}
        process = int(theirs.pop("process"))
    except (TimeoutError, EOFError, ValueError, KeyError, AttributeError, TypeError):
        wire.close()  # a stranger
        return
    ours = json.loads(json.dumps(about))
    differs = sorted({*changed(ours, theirs), *changed(theirs, ours)})
    if differs:
        keys = ", ".join(differs[:SHOWN])
        _refuse(wire, f"process={process}: its config or its code is not that of process 0, see {keys}")
        raise ConfigError(f"process {process} has another {keys} than process 0: start all with the same keys and code")
    if process in wires:
        _refuse(wires[process], f"another process={process} has come: give each a number of its own")
    wires[process] = wire


def _refuse(wire: Wire, why: str) -> None:
    with contextlib.suppress(OSError):  # it has ended
        wire.send(REFUSED, why)
    wire.close()


def _absent(missing: list[int], coordinator: str, patience: float) -> str:
    names = f"process {missing[0]} has" if len(missing) == 1 else f"processes {', '.join(map(str, missing))} have"
    return f"coordinator={coordinator}: {names} not come within {patience:.0f} s; start all processes with this address"


def _message(line: bytes) -> Message:
    match json.loads(line):
        case [str(kind), str(text)]:
            return kind, text
    raise ValueError("no message")
