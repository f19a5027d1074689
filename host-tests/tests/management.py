"""Manages an insole with smpclient, for host-tests/tests/management_tools.rs.

The first argument is `serial:<input>:<output>` for the FIFO from which an insole reads and the FIFO to which it writes, or
`bluetooth:<port>:<address>` to connect to this address with the virtual Bluetooth controller at this TCP port. Each further
argument is a command. For each command, a line of output has the result as JSON, or {"error": <code>} for a refusal.

    parameters      Reads the size and the number of the insole's buffers (MCUmgr parameters).
    echo:<text>     Sends a text that the insole returns.
    time            Reads the clock.
    set-time:<time> Sets the clock to a time in ISO 8601.
    state           Lists the images.
    erase           Erases the slot for uploads.
    reset           Restarts the insole.
    name:<file>     Returns the SHA-256 that names the image in the file.
    upload:<file>   Uploads the file.
    test:<file>     Marks the image for a trial at the next start.
    confirm:<file>  Confirms the image.

An image is listed as [slot, version, name, pending, confirmed, active].
"""

import asyncio
import json
import os
import pty
import sys
import threading
import tty
from pathlib import Path

from smpclient import SMPClient
from smpclient.exceptions import SMPUploadError
from smpclient.generics import success
from smpclient.mcuboot import IMAGE_TLV, ImageInfo
from smpclient.requests.image_management import (
    ImageErase,
    ImageStatesRead,
    ImageStatesWrite,
)
from smpclient.requests.os_management import (
    DateTimeRead,
    DateTimeWrite,
    EchoWrite,
    MCUMgrParametersRead,
    ResetWrite,
)

# Longest time for an answer.
TIMEOUT_S = 60


def code(refused):
    """The result for a refused request."""
    return {"error": int(refused.err.rc) if hasattr(refused, "err") else int(refused.rc)}


def name(file):
    """The SHA-256 in the trailer of an image file, as smpclient reads it."""
    return ImageInfo.load_file(file).get_tlv(IMAGE_TLV.SHA256).value


def images(answer):
    """The images in an answer, each as a list."""
    return [
        [image.slot, image.version, image.hash.hex(), image.pending, image.confirmed, image.active]
        for image in answer.images
    ]


async def execute(client, command, argument):
    """Executes a command; returns its result."""

    async def request(request, result):
        answer = await client.request(request, timeout_s=TIMEOUT_S)
        return result(answer) if success(answer) else code(answer)

    match command:
        case "parameters":
            return await request(
                MCUMgrParametersRead(), lambda answer: {"buf_size": answer.buf_size, "buf_count": answer.buf_count}
            )
        case "echo":
            return await request(EchoWrite(d=argument), lambda answer: answer.r)
        case "time":
            return await request(DateTimeRead(), lambda answer: answer.datetime)
        case "set-time":
            return await request(DateTimeWrite(datetime=argument), lambda _: {})
        case "state":
            return await request(ImageStatesRead(), images)
        case "erase":
            return await request(ImageErase(), lambda _: {})
        case "reset":
            return await request(ResetWrite(), lambda _: {})
        case "name":
            return name(argument).hex()
        case "test":
            return await request(ImageStatesWrite(hash=name(argument)), images)
        case "confirm":
            return await request(ImageStatesWrite(hash=name(argument), confirm=True), images)
        case "upload":
            offset = None
            try:
                async for offset in client.upload(
                    Path(argument).read_bytes(), first_timeout_s=TIMEOUT_S, subsequent_timeout_s=TIMEOUT_S
                ):
                    pass
            except SMPUploadError as error:
                return code(error.args[0])
            return offset
    raise ValueError(f"{command}: unknown command, see the list at the beginning of management.py")


def serial_port(to_insole, from_insole):
    """Connects a new terminal, which remains open, to two FIFOs. Returns the terminal's name."""
    master, slave = pty.openpty()
    tty.setraw(slave)

    def copy(source, destination):
        while data := os.read(source, 4096):
            os.write(destination, data)

    for ends in ((master, os.open(to_insole, os.O_WRONLY)), (os.open(from_insole, os.O_RDONLY), master)):
        threading.Thread(target=copy, args=ends, daemon=True).start()
    return os.ttyname(slave)


def transport(link):
    """The transport for a link, and the address of the insole."""
    if link.startswith("bluetooth:"):
        from smpclient.transport.bumble import SMPBumbleTransport
        from smpclient.transport.bumble.pairing import NoInputNoOutput

        _, port, address = link.split(":", 2)
        hci = f"tcp-client:127.0.0.1:{port}"
        return SMPBumbleTransport(hci=hci, pair_on_connect=NoInputNoOutput()), address
    from smpclient.transport.serial import SMPSerialTransport

    _, to_insole, from_insole = link.split(":")
    return SMPSerialTransport(), serial_port(to_insole, from_insole)


async def main():
    link, *commands = sys.argv[1:]
    carrier, address = transport(link)
    async with SMPClient(carrier, address, timeout_s=TIMEOUT_S) as client:
        for command in commands:
            command, _, argument = command.partition(":")
            print(json.dumps(await execute(client, command, argument)), flush=True)


asyncio.run(main())
# `os._exit` omits the shutdown of the interpreter, during which the threads of the terminal would still read from the link.
sys.stdout.flush()
os._exit(0)
