"""Moves a stage with Zaber's own library, a line of protocol at a time. Argument: serial port."""

import json
import sys

from zaber_motion.ascii import Connection

with Connection.open_serial_port(sys.argv[1], direct=True) as connection:
    connection.default_request_timeout = 3000
    connection.checksum_enabled = True
    device = connection.get_device(1)
    axis = device.get_axis(1)
    first = device.generic_command("get pos", axis=1)
    axis.generic_command("home")
    axis.wait_until_idle()
    axis.generic_command("move abs 20000")
    busy = axis.is_busy()
    axis.wait_until_idle()
    at = device.generic_command("get pos", axis=1)
    try:
        device.generic_command("no such thing", axis=1)
        refused = None
    except Exception as error:
        refused = type(error).__name__
    print(json.dumps({
        "warning_before": first.warning_flag,
        "busy": busy,
        "at": at.data,
        "status": at.status,
        "warning": at.warning_flag,
        "refused": refused,
    }))
