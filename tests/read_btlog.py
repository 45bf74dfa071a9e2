"""Reads a .btlog with the standard library alone and prints its transitions.

    python3 tests/read_btlog.py run.btlog

Ends with 1 when the file is damaged, when a transition names a node that the tree has not, or when times go back.
"""

import struct
import sys
import xml.etree.ElementTree as ElementTree

STATUS = ["IDLE", "RUNNING", "SUCCESS", "FAILURE", "SKIPPED"]


def main(path: str) -> int:
    with open(path, "rb") as stream:
        data = stream.read()
    if data[:18] != b"BTCPP4-FileLogger2" or data[18] != 1:
        print("this is no FileLogger2 file of version 1", file=sys.stderr)
        return 1
    (n_bytes,) = struct.unpack_from("<i", data, 19)
    root = ElementTree.fromstring(data[23 : 23 + n_bytes].decode())
    names = {int(node.get("_uid")): node.get("name") or node.get("ID") for node in root.iter() if node.get("_uid")}
    (start_us,) = struct.unpack_from("<q", data, 23 + n_bytes)
    rows = data[31 + n_bytes :]
    print(f"{len(names)} nodes, {len(rows) // 9} transitions from {start_us / 1e6:.6f} s since 1970")
    last_us = 0
    for low, high, uid, status in struct.iter_unpack("<IHHB", rows[: len(rows) // 9 * 9]):
        micros = high << 32 | low
        if uid not in names or status >= len(STATUS) or micros < last_us:
            print(f"bad transition: {micros} us, node {uid}, status {status}", file=sys.stderr)
            return 1
        print(f"{micros / 1e6:12.6f}  {uid:5}  {names[uid]:24}  {STATUS[status]}")
        last_us = micros
    return int(len(rows) % 9 != 0)


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
