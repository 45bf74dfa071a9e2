"""Looks on at a live run as Foxglove does, with the PyPI package websockets alone, and lists the channels that it received.

    pip install websockets
    sfg run scenarios/01_pour.yaml --foxglove 8765 &
    python3 tests/foxglove_client.py 8765 [SECONDS] [--pour]

Ends with 1 when the server does not answer; with --pour also when a channel that a pouring run has was not received.
"""

import asyncio
import json
import struct
import sys
import time
from collections import Counter

import websockets

STREAMS = ["/robot", "/joint_states", "/tf", "/truth", "/synergy", "/motors", "/journal"]
ONCE = ["/run", "/tree/definition", "/tf_static", "/scene", "/scene/grasp", "/functionality", "/inventory", "/masks", "/key_point", "/candidates",
        "/cloud", "/camera/left/image", "/camera/right/depth", "/camera/left/calibration", "/camera/left/annotations"]


async def look(port: int, secs: float) -> tuple[dict[str, str], Counter[str]]:
    topics: dict[int, str] = {}
    advertised: dict[str, str] = {}
    counts: Counter[str] = Counter()
    uri = f"ws://127.0.0.1:{port}"
    async with websockets.connect(uri, subprotocols=["foxglove.sdk.v1"], max_size=None) as socket:
        until = time.monotonic() + secs
        while time.monotonic() < until:
            try:
                message = await asyncio.wait_for(socket.recv(), until - time.monotonic())
            except (TimeoutError, asyncio.TimeoutError, websockets.ConnectionClosed):
                break
            if isinstance(message, str):
                said = json.loads(message)
                if said["op"] == "advertise":
                    new = said["channels"]
                    topics.update({channel["id"]: channel["topic"] for channel in new})
                    advertised.update({channel["topic"]: channel["schemaName"] for channel in new})
                    # A channel's number serves as the number of its subscription.
                    wanted = [{"id": channel["id"], "channelId": channel["id"]} for channel in new]
                    await socket.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))
            elif message[0] == 1:
                subscription, _log_time = struct.unpack_from("<IQ", message, 1)
                counts[topics[subscription]] += 1
    return advertised, counts


if __name__ == "__main__":
    arguments = [argument for argument in sys.argv[1:] if argument != "--pour"]
    if not arguments:
        sys.exit(__doc__)
    try:
        found, received = asyncio.run(look(int(arguments[0]), float(arguments[1]) if len(arguments) > 1 else 5.0))
    except OSError as error:
        sys.exit(f"port {arguments[0]}: {error}")
    for topic in sorted(found):
        print(f"{received[topic]:8}  {topic}  {found[topic]}")
    lost = [topic for topic in STREAMS + ONCE if received[topic] == 0] if "--pour" in sys.argv else []
    if lost:
        sys.exit("not received: " + ", ".join(lost))
