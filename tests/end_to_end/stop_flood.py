"""Somebody who may only look and says STOP as often as the bytes that they may send allow.

`stop_flood.py HOST:PORT ROBOT_ID SECONDS CA CERTIFICATE KEY`: 500 a second in each of 4 sessions,
without a payload. Whenever it is shown out it comes again. Prints how many it sent.
"""

import contextlib
import sys
import threading
import time
from pathlib import Path

import zenoh

from mbot_protocol.keys import STOP
from mbot_workstation.link.address import Endpoint
from mbot_workstation.link.robot_session import open_session
from mbot_workstation.link.security import LinkSecurity

SESSIONS = 4
A_SECOND = 500
HEAP = 40


def main() -> None:
    address, robot_id, seconds, ca, certificate, key = sys.argv[1:]
    host, _, port = address.rpartition(":")
    endpoint = Endpoint("tls", host, int(port))
    security = LinkSecurity(Path(ca), Path(certificate), Path(key))
    until_s = time.monotonic() + float(seconds)
    sent = [0] * SESSIONS

    def flood(number: int) -> None:
        while time.monotonic() < until_s:
            with contextlib.suppress(Exception), open_session(endpoint, security) as session:
                stop = STOP.key(robot_id)
                while time.monotonic() < until_s and session.info.peers_zid():
                    for _ in range(HEAP):
                        session.get(stop, handler=zenoh.handlers.RingChannel(1), timeout=1.0)
                        sent[number] += 1
                    time.sleep(HEAP / A_SECOND)
            time.sleep(0.05)

    threads = [threading.Thread(target=flood, args=(number,)) for number in range(SESSIONS)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(float(seconds) + 20)
    print(sent, flush=True)


if __name__ == "__main__":
    main()
