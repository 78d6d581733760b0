"""Switches a projector with aiopjlink. Arguments: port, and the password if there is one."""

import asyncio
import json
import sys

from aiopjlink import PJLink, PJLinkPassword

port = int(sys.argv[1])
password = sys.argv[2] if len(sys.argv) > 2 else None


async def main():
    found = {}
    if password:
        try:
            async with PJLink("127.0.0.1", port, password="no " + password):
                found["refused"] = False
        except PJLinkPassword:
            found["refused"] = True
    async with PJLink("127.0.0.1", port, password=password) as link:
        found["before"] = (await link.power.get()).name
        await link.power.set(link.power.ON)
        while (await link.power.get()).name != "ON":
            await asyncio.sleep(0.05)
        await link.mute.both(True)
        found["muted"] = await link.mute.status()
        await link.mute.both(False)
        found["unmuted"] = await link.mute.status()
        found["lamps"] = [[hours, state.name] for hours, state in await link.lamps.status()]
        found["errors"] = {k.name: v.name for k, v in (await link.errors.query()).items()}
        found["maker"] = await link.info.manufacturer_name()
    print(json.dumps(found))


asyncio.run(main())
