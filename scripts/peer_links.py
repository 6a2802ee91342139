"""By what a payload goes between two Python processes: plain means, Teseo's transport, its peers.

Each fills the payload in full, and reads every byte of it. Where a binding gives its memory away, it
is filled and read where it lies; where it does not, its copies count.
"""

import ctypes
import json
import mmap
import os
import socket
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple, Protocol

PEER_COMES_MAX_S = 20
"""However long one side waits for the other to come."""

CYCLONE = """<CycloneDDS><Domain>
<General><AllowMulticast>false</AllowMulticast>
<Interfaces><NetworkInterface name="lo" multicast="false"/></Interfaces>
<MaxMessageSize>65500B</MaxMessageSize><FragmentSize>65000B</FragmentSize></General>
<Internal><SocketReceiveBufferSize max="4MiB"/></Internal>
<Discovery><ParticipantIndex>auto</ParticipantIndex><Peers><Peer address="127.0.0.1"/></Peers></Discovery>
</Domain></CycloneDDS>"""
"""Only loopback; and what its guide advises for large samples, which makes little of a difference."""

memset = ctypes.PyDLL(None).memset
memset.argtypes, memset.restype = [ctypes.c_void_p, ctypes.c_int, ctypes.c_size_t], None
memcmp = ctypes.PyDLL(None).memcmp
memcmp.argtypes = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_size_t]
address_of_bytes = ctypes.pythonapi.PyBytes_AsString
address_of_bytes.argtypes, address_of_bytes.restype = [ctypes.py_object], ctypes.c_void_p


def address_of(buffer: Any) -> int:
    """Where the bytes of something writable are."""
    return ctypes.addressof(ctypes.c_char.from_buffer(buffer))


def is_whole(address: int, value: int, size: int) -> bool:
    """Reads every byte: the first is `value`, and each is what the one before it is."""
    first = ctypes.c_ubyte.from_address(address).value
    return first == value and memcmp(address, address + 1, size - 1) == 0


def wait_until(is_so: Callable[[], Any]) -> None:
    """Until the other side has come."""
    until = time.monotonic() + PEER_COMES_MAX_S
    while not is_so():
        if until < time.monotonic():
            raise TimeoutError("the other side did not come")
        time.sleep(0.005)


class Link(Protocol):
    """One side's end of a way."""

    def send(self, value: int) -> None:
        """Sends a payload in which every byte is `value`."""

    def receive(self, value: int) -> bool:
        """Waits for the next payload, and says whether every byte of it is `value`."""


class Flag:
    """Memory that both map, and a byte that the receiver looks at again and again."""

    def __init__(self, asks: bool, size: int) -> None:
        self.size, lane = size, mmap.PAGESIZE * (1 + -(-size // mmap.PAGESIZE))
        with open("board", "a+b") as file:
            file.truncate(2 * lane)
            self.board = mmap.mmap(file.fileno(), 2 * lane)
        self.mine, self.other = (0, lane) if asks else (lane, 0)
        self.start = address_of(self.board) + mmap.PAGESIZE

    def send(self, value: int) -> None:
        memset(self.start + self.mine, value, self.size)
        self.board[self.mine] = value

    def receive(self, value: int) -> bool:
        board, flag = self.board, self.other
        while board[flag] != value:
            pass
        return is_whole(self.start + flag, value, self.size)


class Buffered:
    """Has memory of its own, from which a payload is copied to be sent."""

    def __init__(self, size: int) -> None:
        self.size, self.buffer = size, bytearray(size)
        self.start = address_of(self.buffer)

    def fill(self, value: int) -> None:
        memset(self.start, value, self.size)

    def is_whole_copy(self, copy: bytes, value: int) -> bool:
        return len(copy) == self.size and is_whole(address_of_bytes(copy), value, self.size)


class Socket(Buffered):
    """A stream between two Unix domain sockets."""

    def __init__(self, asks: bool, size: int) -> None:
        super().__init__(size)
        self.socket = socket.socket(socket.AF_UNIX)
        if asks:
            self.socket.bind("socket.new")
            self.socket.listen(1)
            os.rename("socket.new", "socket")
            self.socket = self.socket.accept()[0]
        else:
            wait_until(lambda: Path("socket").exists())
            self.socket.connect("socket")

    def send(self, value: int) -> None:
        self.fill(value)
        self.socket.sendall(self.buffer)

    def receive(self, value: int) -> bool:
        self.socket.recv_into(self.buffer, self.size, socket.MSG_WAITALL)
        return is_whole(self.start, value, self.size)


class Iceoryx:
    """iceoryx2, which is Teseo's transport. Filled and read where it lies in shared memory."""

    def __init__(self, asks: bool, size: int, sleeps: bool = False) -> None:
        import iceoryx2 as iox

        iox.set_log_level(iox.LogLevel.Error)
        config = iox.config.default()
        config.global_cfg.root_path = iox.Path.new(os.getcwd())
        self.size, self.sleeps = size, sleeps
        self.node = iox.NodeBuilder.new().config(config).create(iox.ServiceType.Ipc)
        names = ("there", "back") if asks else ("back", "there")
        mine, other = (
            self.node.service_builder(iox.ServiceName.new(name))
            .publish_subscribe(iox.Slice[ctypes.c_uint8])
            .open_or_create()
            for name in names
        )
        self.publisher = mine.publisher_builder().initial_max_slice_len(size).create()
        self.subscriber = other.subscriber_builder().create()
        bells = [
            self.node.service_builder(iox.ServiceName.new(name)).event().open_or_create()
            for name in names
        ]
        self.notifier = bells[0].notifier_builder().create()
        self.listener = bells[1].listener_builder().create()
        self.services = (mine, other, bells)
        wait_until(lambda: mine.dynamic_config.number_of_subscribers == 1)
        wait_until(lambda: bells[0].dynamic_config.number_of_listeners == 1)

    def send(self, value: int) -> None:
        sample = self.publisher.loan_slice_uninit(self.size)
        memset(sample.payload_ptr, value, self.size)
        sample.assume_init().send()
        if self.sleeps:
            self.notifier.notify()

    def receive(self, value: int) -> bool:
        while (sample := self.subscriber.receive()) is None:
            if self.sleeps:
                self.listener.blocking_wait()
        whole = is_whole(sample.payload_ptr, value, self.size)
        sample.delete()
        return whole


class Zenoh(Buffered):
    """Zenoh between two peers. Its binding fills shared memory by a copy, and reads any by one."""

    def __init__(self, asks: bool, size: int, shared: bool = False) -> None:
        import zenoh

        config = zenoh.Config()
        config.insert_json5("scouting/multicast/enabled", "false")
        config.insert_json5("transport/shared_memory/enabled", json.dumps(shared))
        there = '["tcp/127.0.0.1:7447"]'
        config.insert_json5("listen/endpoints", there if asks else "[]")
        config.insert_json5("connect/endpoints", "[]" if asks else there)
        super().__init__(size)
        self.session, self.provider = zenoh.open(config), None
        if shared:
            self.policy = zenoh.shm.BlockOn(zenoh.shm.GarbageCollect())
            # It is locked into memory, of which no more than 8 MiB may be, with that of the other.
            self.provider = zenoh.shm.ShmProvider.default_backend(2 * size + 65_536)
        names = ("there", "back") if asks else ("back", "there")
        self.subscriber = self.session.declare_subscriber(names[1])
        block = zenoh.CongestionControl.BLOCK
        self.publisher = self.session.declare_publisher(
            names[0], congestion_control=block, express=True
        )
        wait_until(lambda: self.publisher.matching_status.matching)

    def send(self, value: int) -> None:
        self.fill(value)
        if self.provider is None:
            self.publisher.put(self.buffer)
            return
        payload = self.provider.alloc(self.size, self.policy)
        payload[0 : self.size] = self.buffer
        self.publisher.put(payload)

    def receive(self, value: int) -> bool:
        payload = self.subscriber.recv().payload
        if self.provider is not None and payload.as_shm() is None:
            raise RuntimeError("came by another way than shared memory")
        return self.is_whole_copy(payload.to_bytes(), value)


class Cyclone(Buffered):
    """CycloneDDS, reliable, by UDP over loopback. Its binding copies as it serialises and back."""

    def __init__(self, asks: bool, size: int) -> None:
        os.environ["CYCLONEDDS_URI"] = CYCLONE
        from cyclonedds.core import ReadCondition, SampleState, WaitSet
        from cyclonedds.domain import DomainParticipant
        from cyclonedds.idl import make_idl_struct
        from cyclonedds.idl.types import array, uint8
        from cyclonedds.pub import DataWriter
        from cyclonedds.qos import Policy, Qos
        from cyclonedds.sub import DataReader
        from cyclonedds.topic import Topic

        super().__init__(size)
        self.sample = make_idl_struct("Payload", "Payload", {"data": array[uint8, size]})
        self.participant = DomainParticipant(0)
        reliable = Policy.Reliability.Reliable(10**10)
        qos = Qos(reliable, Policy.History.KeepLast(4))
        names = ("there", "back") if asks else ("back", "there")
        mine, other = (Topic(self.participant, name, self.sample) for name in names)
        self.writer = DataWriter(self.participant, mine, qos)
        self.reader = DataReader(self.participant, other, qos)
        self.waits = WaitSet(self.participant)
        self.waits.attach(ReadCondition(self.reader, SampleState.NotRead))
        wait_until(lambda: self.writer.get_matched_subscriptions())
        wait_until(lambda: self.reader.get_matched_publications())

    def send(self, value: int) -> None:
        self.fill(value)
        self.writer.write(self.sample(data=self.buffer))

    def receive(self, value: int) -> bool:
        self.waits.wait(10**10)
        (sample,) = self.reader.take()
        return self.is_whole_copy(sample.data, value)


class Dora(Buffered):
    """dora, whose daemon starts both as nodes of a dataflow. Sends by a copy, read where it lies."""

    def __init__(self, asks: bool, size: int) -> None:
        import dora
        import pyarrow

        super().__init__(size)
        self.arrow, self.node = pyarrow, dora.Node()

    def send(self, value: int) -> None:
        self.fill(value)
        buffers = [None, self.arrow.py_buffer(self.buffer)]
        array = self.arrow.Array.from_buffers(self.arrow.uint8(), self.size, buffers)
        self.node.send_output("payload", array)

    def receive(self, value: int) -> bool:
        while (event := self.node.next())["type"] != "INPUT":
            pass
        array = event["value"]
        address = array.buffers()[1].address + array.offset
        return len(array) == self.size and is_whole(address, value, self.size)


class Way(NamedTuple):
    """By what a payload goes."""

    open: Callable[[bool, int], Link]
    looks: bool
    """Whether who waits looks again and again; else he sleeps until he is woken."""
    package: str | None
    note: str


WAYS = {
    "flag": Way(Flag, True, None, "a byte in shared memory, and the payload beside it; no copy"),
    "iceoryx2, polled": Way(Iceoryx, True, "iceoryx2", "Teseo's transport; no copy"),
    "unix socket": Way(Socket, False, None, "a stream; copied into the kernel and out of it"),
    "iceoryx2, listener": Way(
        lambda asks, size: Iceoryx(asks, size, sleeps=True),
        False,
        "iceoryx2",
        "Teseo's transport; no copy",
    ),
    "zenoh, shared memory": Way(
        lambda asks, size: Zenoh(asks, size, shared=True),
        False,
        "eclipse-zenoh",
        "its provider; the binding copies once to fill and once to read",
    ),
    "zenoh, TCP": Way(Zenoh, False, "eclipse-zenoh", "its default between peers, over loopback"),
    "cyclonedds, UDP": Way(
        Cyclone,
        False,
        "cyclonedds",
        "reliable, over loopback: the package has no plugin for shared memory (PSMX)",
    ),
    "dora": Way(
        Dora, False, "dora-rs", "two nodes and its daemon; copies to send, reads where it lies"
    ),
}
