"""Reads every channel of a run.mcap with the PyPI packages mcap and mcap-protobuf-support.

    pip install mcap mcap-protobuf-support
    python3 tests/read_recording.py runs/.../run.mcap [--pour]

Prints how many messages each channel has. Ends with 1 when a message cannot be decoded, a JSON message is no object or lacks
what its schema requires, or a check sum is wrong; with --pour also when a channel that a pouring run has is missing.
"""

import json
import sys
from collections import Counter

from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

POUR = {
    "/run": "sfg.Run.v1",
    "/tree/definition": "sfg.TreeDefinition.v1",
    "/tree": "sfg.Transition.v1",
    "/journal": "sfg.Journal.v1",
    "/blackboard": "sfg.Write.v1",
    "/stages": "sfg.Stage.v1",
    "/functionality": "sfg.Functionality.v1",
    "/inventory": "sfg.Inventory.v1",
    "/masks": "sfg.Masks.v1",
    "/key_point": "sfg.KeyPoint.v1",
    "/candidates": "sfg.Candidates.v1",
    "/robot": "sfg.RobotSample.v1",
    "/synergy": "sfg.Synergy.v1",
    "/motors": "sfg.Motors.v1",
    "/truth": "sfg.Truth.v1",
    "/verdict": "sfg.Verdict.v1",
    "/tf_static": "foxglove.FrameTransforms",
    "/tf": "foxglove.FrameTransforms",
    "/scene": "foxglove.SceneUpdate",
    "/scene/grasp": "foxglove.SceneUpdate",
    "/cloud": "foxglove.PointCloud",
    "/joint_states": "foxglove.JointStates",
    "/log": "foxglove.Log",
}
for camera in ("left", "right"):
    POUR[f"/camera/{camera}/image"] = "foxglove.CompressedImage"
    POUR[f"/camera/{camera}/depth"] = "foxglove.CompressedImage"
    POUR[f"/camera/{camera}/calibration"] = "foxglove.CameraCalibration"
    POUR[f"/camera/{camera}/annotations"] = "foxglove.ImageAnnotations"


def main(path: str, is_pour: bool) -> int:
    counts: Counter[str] = Counter()
    schemas: dict[str, str] = {}
    wrong: list[str] = []
    with open(path, "rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        for schema, channel, message in reader.iter_messages():
            counts[channel.topic] += 1
            schemas[channel.topic] = schema.name
            if channel.message_encoding == "json":
                value = json.loads(message.data)
                required = json.loads(schema.data).get("required", [])
                missing = [key for key in required if key not in value]
                if not isinstance(value, dict) or missing:
                    wrong.append(f"{channel.topic}: message {message.sequence} lacks {missing}")
        for _schema, channel, _message, decoded in reader.iter_decoded_messages(topics=[topic for topic, name in schemas.items() if name.startswith("foxglove.")]):
            if channel.message_encoding == "protobuf" and decoded.DESCRIPTOR.full_name != schemas[channel.topic]:
                wrong.append(f"{channel.topic}: decoded as {decoded.DESCRIPTOR.full_name}")
        for record in reader.iter_metadata():
            print(record.name, json.dumps(record.metadata, sort_keys=True))
        for attachment in reader.iter_attachments():
            print("attachment", attachment.name, len(attachment.data), "bytes")
    for topic in sorted(counts):
        print(f"{counts[topic]:8}  {topic}  {schemas[topic]}")
    if is_pour:
        wrong += [f"{topic} {name} is missing" for topic, name in POUR.items() if schemas.get(topic) != name]
    for line in wrong[:20]:
        print(line, file=sys.stderr)
    return 1 if wrong else 0


if __name__ == "__main__":
    arguments = [argument for argument in sys.argv[1:] if argument != "--pour"]
    if len(arguments) != 1:
        sys.exit(__doc__)
    try:
        sys.exit(main(arguments[0], "--pour" in sys.argv))
    except (OSError, McapError) as error:
        sys.exit(f"{arguments[0]}: {error}")
