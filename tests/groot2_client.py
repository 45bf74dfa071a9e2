"""Asks a Groot2 server for everything Groot2 asks for, with the PyPI packages pyzmq and msgpack, and prints the answers.

    cargo run -p sfg-tree --example groot2 &
    python3 tests/groot2_client.py [port]

Ends with 1 when an answer is not what the protocol says.
"""

import collections
import random
import struct
import sys
import time
import xml.etree.ElementTree as ElementTree

import msgpack
import zmq

STATUS = ["IDLE", "RUNNING", "SUCCESS", "FAILURE", "SKIPPED"]


class Client:
    def __init__(self, port: int) -> None:
        context = zmq.Context.instance()
        self.socket = context.socket(zmq.REQ)
        self.subscriber = context.socket(zmq.SUB)
        for socket, number in [(self.socket, port), (self.subscriber, port + 1)]:
            socket.linger = 0
            socket.rcvtimeo = 3000
            # ZeroMQ then sends pings of its own.
            socket.heartbeat_ivl = 200
            socket.heartbeat_timeout = 1000
            socket.connect(f"tcp://127.0.0.1:{number}")
        self.subscriber.subscribe(b"")

    def ask(self, kind: str, *rest: str) -> list[bytes]:
        header = struct.pack("<BBI", 2, ord(kind), random.getrandbits(32))
        self.socket.send_multipart([header, *(text.encode() for text in rest)])
        parts = self.socket.recv_multipart()
        if parts[0] != b"error":
            assert parts[0][:6] == header and len(parts[0]) == 22, parts[0]
        return parts


def main(port: int = 1667) -> int:
    client = Client(port)
    header, xml = client.ask("T")
    uuid = header[6:]
    assert uuid[6] >> 4 == 4 and uuid[8] >> 6 == 2, uuid
    root = ElementTree.fromstring(xml.decode())
    nodes = {int(node.get("_uid")): node for node in root.iter() if node.get("_uid")}
    trees = [tree.get("_fullpath") or tree.get("ID") for tree in root.iter("BehaviorTree")]
    print(f"tree {uuid.hex()}: {len(nodes)} nodes, {len(root.find('TreeNodesModel'))} models, blackboards {trees}")

    print("recording since", client.ask("r", "start")[1].decode(), "us")
    seen = collections.defaultdict(set)
    for _ in range(30):
        header, status = client.ask("S")
        assert header[6:] == uuid and len(status) == 3 * len(nodes)
        for uid, byte in struct.iter_unpack("<HB", status):
            seen[uid].add(byte)
        time.sleep(0.05)
    for uid, node in nodes.items():
        words = [STATUS[byte] if byte < 10 else f"IDLE after {STATUS[byte - 10]}" for byte in sorted(seen[uid])]
        print(f"{uid:5}  {node.tag:22} {node.get('name') or node.get('ID'):20} {', '.join(words)}")

    board = msgpack.unpackb(client.ask("B", ";".join([*trees, "nobody"]))[1])
    assert list(board) == trees, board
    for name, entries in board.items():
        print(f"blackboard {name}: {entries}")

    transitions = client.ask("t")[1]
    for low, high, uid, status in struct.iter_unpack("<IHHB", transitions):
        assert uid in nodes and status < len(STATUS), (uid, status)
    print(f"{len(transitions) // 9} transitions recorded, then {len(client.ask('t')[1])} bytes")
    assert len(client.ask("r", "stop")) == 1

    assert client.ask("D")[1] == b"[]"
    for kind in "IURAX":
        assert client.ask(kind, "{}") == [b"error", b"read-only"], kind
    assert client.ask("?") == [b"error", b"Request not recognized"]
    client.socket.send(b"short")
    assert client.socket.recv_multipart() == [b"error", b"wrong request header"]
    try:
        print("published:", client.subscriber.recv_multipart(zmq.NOBLOCK))
        return 1
    except zmq.Again:
        print("hooks refused, nothing published: all as the protocol says")
    return 0


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:])))
