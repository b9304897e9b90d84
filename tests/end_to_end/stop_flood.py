"""Somebody who may only look and says STOP as often as the bytes that they may send allow.

`stop_flood.py HOST:PORT ROBOT_ID SECONDS CA CERTIFICATE KEY [A_SECOND]`: 500 a second, or so many,
in each of 4 sessions, without a payload. Whenever it is shown out it comes again. Prints how many
it sent.
"""

import contextlib
import sys
import threading
import time
from pathlib import Path

import zenoh

from mbot_protocol.wire.keys import STOP
from mbot_workstation.fleet.link.address import Endpoint
from mbot_workstation.fleet.link.robot_session import open_session
from mbot_workstation.fleet.link.security import LinkSecurity

SESSIONS = 4
A_SECOND = 500
HEAP = 40


def main() -> None:
    address, robot_id, seconds, ca, certificate, key, *rate = sys.argv[1:]
    a_second = int(rate[0]) if rate else A_SECOND
    host, _, port = address.rpartition(":")
    endpoint = Endpoint("tls", host, int(port))
    security = LinkSecurity(Path(ca), Path(certificate), Path(key))
    until_s = time.monotonic() + float(seconds)
    sent = [0] * SESSIONS

    def flood(number: int) -> None:
        while time.monotonic() < until_s:
            with contextlib.suppress(Exception), open_session(endpoint, security) as session:
                stop = STOP.key(robot_id)
                info = session.info
                while time.monotonic() < until_s and (info.peers_zid() or info.routers_zid()):
                    for _ in range(HEAP):
                        session.get(stop, handler=zenoh.handlers.RingChannel(1), timeout=1.0)
                        sent[number] += 1
                    time.sleep(HEAP / a_second)
            time.sleep(0.05)

    threads = [threading.Thread(target=flood, args=(number,)) for number in range(SESSIONS)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(float(seconds) + 20)
    print(sent, flush=True)
    sys.exit(0 if all(sent) else 1)


if __name__ == "__main__":
    main()
