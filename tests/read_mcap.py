"""Reads a run.mcap with the PyPI package mcap and prints how many messages each topic has.

    python3 tests/read_mcap.py runs/.../run.mcap

Ends with 1 when a topic is missing or empty, when a message is not JSON, or when a topic's stamps go back.
"""

import json
import sys
from collections import Counter

from mcap.exceptions import McapError
from mcap.reader import make_reader

TOPICS = ["/robot", "/tree", "/stages", "/verdict"]


def main(path: str) -> int:
    counts: Counter[str] = Counter()
    stamps: dict[str, int] = {}
    with open(path, "rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        for schema, channel, message in reader.iter_messages():
            topic = channel.topic
            counts[topic] += 1
            if not isinstance(json.loads(message.data), dict):
                print(f"{topic}: message {message.sequence} is no object", file=sys.stderr)
                return 1
            json.loads(schema.data)
            if message.log_time < stamps.get(topic, 0):
                print(f"{topic}: message {message.sequence} is stamped before the one ahead of it", file=sys.stderr)
                return 1
            stamps[topic] = message.log_time
        for record in reader.iter_metadata():
            print(record.name, json.dumps(record.metadata, sort_keys=True))
    for topic in sorted(counts):
        print(f"{counts[topic]:8}  {topic}")
    missing = [topic for topic in TOPICS if counts[topic] == 0]
    if missing:
        print("missing: " + ", ".join(missing), file=sys.stderr)
    return 1 if missing else 0


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    try:
        sys.exit(main(sys.argv[1]))
    except (OSError, McapError) as error:
        sys.exit(f"{sys.argv[1]}: {error}")
