"""A peer that knows nothing of stillpoint: the package eclipse-zenoh, one endpoint, one key.

python_peer.py ENDPOINT take|put KEY [CERTIFICATE PRIVATE_KEY AUTHORITY]
"""

import json
import struct
import sys

import zenoh

# Header of the sample (stamp, origin, sequence, incarnation, count), sending end, number at this end.
ATTACHMENT = "<QQQIIQQ"


def main():
    endpoint, action, key, *tls = sys.argv[1:]
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    config.insert_json5("connect/timeout_ms", "3000")
    config.insert_json5("scouting/multicast/enabled", "false")
    if tls:
        names = ["connect_certificate", "connect_private_key", "root_ca_certificate"]
        files = dict(zip(names, tls), enable_mtls=True)
        config.insert_json5("transport/link/tls", json.dumps(files))
    try:
        session = zenoh.open(config)
    except zenoh.ZError as error:
        print("refused", error, flush=True)
        return
    if action == "take":
        subscriber = session.declare_subscriber(key)
        print("ready", flush=True)
        sample = subscriber.recv()
        fields = struct.unpack(ATTACHMENT, sample.attachment.to_bytes())
        body = sample.payload.to_bytes()
        print(json.dumps([str(sample.key_expr), fields[2], fields[4], len(body), body[0]]), flush=True)
    else:
        # A sample of a sending end that no beat has announced.
        attachment = struct.pack(ATTACHMENT, 1, 1, 0, 0, 64, 12345, 1)
        for _ in range(20):
            session.put(key, bytes(64), attachment=attachment)
        print("put", flush=True)
    session.close()


main()
