"""Switches a projector with pypjlink2. Arguments: port, and the password if there is one."""

import json
import sys
import time

from pypjlink import MUTE_AUDIO, MUTE_VIDEO, Projector

port = int(sys.argv[1])
password = sys.argv[2] if len(sys.argv) > 2 else None
with Projector.from_address("127.0.0.1", port, timeout=10) as projector:
    authenticated = projector.authenticate(password)
    before = projector.get_power()
    projector.set_power("on")
    states = set()
    while projector.get_power() != "on":
        states.add(projector.get_power())
        time.sleep(0.05)
    projector.set_input("DIGITAL", 1)
    projector.set_mute(MUTE_VIDEO | MUTE_AUDIO, True)
    muted = projector.get_mute()
    projector.set_mute(MUTE_VIDEO | MUTE_AUDIO, False)
    print(json.dumps({
        "authenticated": authenticated,
        "before": before,
        "states": sorted(states),
        "input": projector.get_input(),
        "muted": muted,
        "unmuted": projector.get_mute(),
        "lamps": projector.get_lamps(),
        "errors": projector.get_errors(),
        "maker": projector.get_manufacturer(),
    }))
