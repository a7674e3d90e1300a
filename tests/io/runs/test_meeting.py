"""Processes that share a run meet at an address, and begin together or not at all."""

import contextlib
import socket
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

from urbanjax.io.runs import meeting
from urbanjax.types import ConfigError, ProcessError, UrbanJaxError

ABOUT = {"config": {"seed": 0, "sim": {"period": 0.1}}, "code": {"commit": "c"}}


@pytest.fixture
def coordinator():
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return f"127.0.0.1:{one.getsockname()[1]}"


def meet(coordinator, *others, processes=None, patience=10.0):
    """What each process has of it, a mapping of wires or what it raised: process 0 first."""
    count = 1 + len(others) if processes is None else processes

    def process(number):
        with contextlib.ExitStack() as stack:
            try:
                if number:
                    wires = meeting.join(coordinator, number, about=others[number - 1], patience=patience)
                else:
                    wires = meeting.host(coordinator, count, about=ABOUT, patience=patience)
            except UrbanJaxError as error:
                return error
            stack.pop_all()
            return wires

    with ThreadPoolExecutor() as pool:
        return list(pool.map(process, range(1 + len(others))))


def close(*found):
    for wires in found:
        for wire in wires.values():
            wire.close()


def test_all_have_a_wire_to_process_0_once_all_have_come(coordinator):
    first, one, two = meet(coordinator, ABOUT, ABOUT)
    assert [sorted(wires) for wires in (first, one, two)] == [[1, 2], [0], [0]]
    first[2].send("told", "ünd\n")
    two[0].send("done")
    assert two[0].first(5.0) == ("told", "ünd\n")
    assert first[2].first(5.0) == ("done", "")
    one[0].close()
    with pytest.raises(EOFError):
        first[1].first(5.0)
    close(first, two)
    assert meet(coordinator, patience=0.1) == [{}]  # the port is free again


def test_a_process_of_another_config_ends_both_and_the_key_is_named(coordinator):
    ended = meet(coordinator, {**ABOUT, "config": {"seed": 0, "sim": {"period": 0.2}}})
    assert [type(error) for error in ended] == [ConfigError, ProcessError]
    assert "process 1 has another config.sim.period than process 0" in str(ended[0])
    assert "process=1: its config or its code is not that of process 0, see config.sim.period" in str(ended[1])


def test_who_never_comes_is_named(coordinator):
    ended = meet(coordinator, ABOUT, processes=4, patience=0.5)
    assert "processes 2, 3 have not come within 0 s" in str(ended[0])
    assert "process 0 has not begun: " in str(ended[1])
    with pytest.raises(ConfigError, match="process 0 has not come within 0 s"):
        meeting.join(coordinator, 1, about=ABOUT, patience=0.3)
    with pytest.raises(ConfigError, match=r"there is no host 'no\.such\.host\.invalid'"):
        meeting.join("no.such.host.invalid:1", 1, about=ABOUT, patience=0.3)


def test_a_port_that_is_taken_is_named(coordinator):
    message = r"process 0 cannot listen there \(Address already in use\); give a free port"
    with socket.create_server(meeting.address(coordinator)), pytest.raises(ConfigError, match=message):
        meeting.host(coordinator, 2, about=ABOUT, patience=1.0)


def test_something_else_that_answers_is_not_taken_for_process_0(coordinator):
    with socket.create_server(meeting.address(coordinator)) as server, ThreadPoolExecutor(1) as pool:
        joined = pool.submit(meeting.join, coordinator, 1, about=ABOUT, patience=5.0)
        other, _ = server.accept()
        with other:
            other.sendall(b"HTTP/1.1 400 Bad Request\r\n")
            with pytest.raises(ConfigError, match="what answers there is not process 0"):
                joined.result(10.0)


def test_strangers_are_turned_away(coordinator):
    with ThreadPoolExecutor(1) as pool:
        hosted = pool.submit(meeting.host, coordinator, 2, about=ABOUT, patience=10.0)
        for said in (b"GET / HTTP/1.1\r\n", b'["hello", "1"]\n', b'["welcome", "{}"]\n'):
            with _connected(coordinator) as stranger:
                stranger.sendall(said)
                assert stranger.recv(10) == b""
        joined = meeting.join(coordinator, 1, about=ABOUT, patience=10.0)
        close(hosted.result(10.0), joined)


def test_who_comes_again_takes_the_place_of_who_came_before(coordinator):
    with ThreadPoolExecutor(3) as pool:
        hosted = pool.submit(meeting.host, coordinator, 3, about=ABOUT, patience=10.0)
        before = pool.submit(meeting.join, coordinator, 1, about=ABOUT, patience=10.0)
        time.sleep(0.5)
        again = pool.submit(meeting.join, coordinator, 1, about=ABOUT, patience=10.0)
        with pytest.raises(ProcessError, match="another process=1 has come: give each a number of its own"):
            before.result(10.0)
        joined = meeting.join(coordinator, 2, about=ABOUT, patience=10.0)
        close(hosted.result(10.0), again.result(10.0), joined)


def test_messages_come_whole_and_nothing_else_is_one():
    left, right = (meeting.Wire(one) for one in socket.socketpair())
    left.connection.sendall(b'["told", "a"]\n["do')
    assert right.receive(1.0) == [("told", "a")]
    left.connection.sendall(b'ne", ""]\n')
    assert right.receive(1.0) == [("done", "")]
    for text in (b"[]\n", b"[1, 2]\n", b"{}\n", b"1\n", b"x\n"):
        left.connection.sendall(text)
        with pytest.raises(ValueError):  # noqa: PT011
            right.receive(1.0)
    with pytest.raises(TimeoutError):
        right.receive(0.01)
    close({0: left, 1: right})


@pytest.mark.parametrize("typed", ["127.0.0.1", "127.0.0.1:x", ":80", "host:0", "host:65536", "host:²"])
def test_an_address_has_a_host_and_a_port(typed):
    with pytest.raises(ConfigError, match="give HOST:PORT of process 0"):
        meeting.address(typed)
    assert meeting.address("[::1]:80") == ("::1", 80)


def _connected(coordinator):
    while True:
        with contextlib.suppress(ConnectionRefusedError):
            return socket.create_connection(meeting.address(coordinator), timeout=10.0)
        time.sleep(0.01)
