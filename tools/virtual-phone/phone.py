"""Phones and radios in software, for tests of the insole's Bluetooth.

One JSON object a line. In: {"do": <command>, ...its arguments}. Out: one {"did": <command>, ...} an order, in order, with
"error" where it failed ("att" is the code of an attribute error); and in between {"value": <hex>, "of": <uuid>, "phone": <name>}
for each notification and indication, and {"lost": <reason>, "phone": <name>} when a connection ends. Bytes pass as they are, in hex.
"""

import asyncio
import json
import logging
import socket
import sys

from bumble.att import ATT_Error, ATT_Exchange_MTU_Request
from bumble.controller import Controller
from bumble.core import UUID, AdvertisingData, ProtocolError
from bumble.device import Device, Peer
from bumble.hci import (
    HCI_CONNECTION_TIMEOUT_ERROR,
    Address,
    HCI_Command_Complete_Event,
    HCI_ErrorCode,
    HCI_StatusReturnParameters,
)
from bumble.host import Host
from bumble.keys import MemoryKeyStore, PairingKeys
from bumble.link import LocalLink
from bumble.pairing import PairingConfig, PairingDelegate
from bumble.transport.common import AsyncPipeSink
from bumble.transport.tcp_server import open_tcp_server_transport_with_socket

PATIENCE_S = 20


def say(**what):
    print(json.dumps(what), flush=True)


def lose(controller):
    """Ends a controller's connections as if the other end were out of range."""
    for connection in list(controller.le_connections.values()):
        controller.on_le_disconnected(connection, HCI_CONNECTION_TIMEOUT_ERROR)


class Radio(Controller):
    """An insole's controller."""

    def on_hci_le_remove_device_from_resolving_list_command(self, command):
        """bumble leaves this one without an answer."""
        self.send_hci_packet(
            HCI_Command_Complete_Event(
                num_hci_command_packets=1,
                command_opcode=command.op_code,
                return_parameters=HCI_StatusReturnParameters(HCI_ErrorCode.SUCCESS),
            )
        )


class Phone:
    """A phone with one connection at most."""

    def __init__(self, name, address, link):
        self.name = name
        self.controller = controller = Controller(name, link=link, public_address=address)
        self.device = Device(
            name=name,
            address=Address(address),
            host=Host(controller, AsyncPipeSink(controller)),
        )
        self.device.keystore = MemoryKeyStore()
        self.connection = None
        self.gone = asyncio.Event()
        self.peer = None
        self.ways = {}

    def bonds_as(self, bonding):
        delegate = PairingDelegate(PairingDelegate.NO_OUTPUT_NO_INPUT)
        self.device.pairing_config_factory = lambda _: PairingConfig(
            sc=True,
            mitm=False,
            bonding=bonding,
            delegate=delegate,
            identity_address_type=PairingConfig.AddressType.RANDOM,
        )

    async def connect(self, address):
        self.gone.clear()
        self.connection = await self.device.connect(Address(address), timeout=PATIENCE_S)
        self.connection.on('disconnection', self.lost)
        self.peer = Peer(self.connection)
        # What was found before, for a phone that remembers the table of an insole that it is bonded with.
        for way in self.ways.values():
            way.client = self.peer.gatt_client

    def lost(self, reason):
        say(lost=int(reason), phone=self.name)
        self.connection = None
        self.gone.set()

    def of(self, radio):
        """True for a phone that is connected to this radio."""
        return self.connection is not None and self.connection.peer_address == radio.random_address

    async def discover(self):
        await self.peer.discover_services()
        table = []
        self.ways = {}
        for service in self.peer.services:
            characteristics = []
            await service.discover_characteristics()
            for way in service.characteristics:
                await way.discover_descriptors()
                uuid = way.uuid.to_hex_str('-').lower()
                self.ways[uuid] = way
                characteristics.append({
                    'uuid': uuid,
                    'properties': int(way.properties),
                    'descriptors': [d.type.to_hex_str('-').lower() for d in way.descriptors],
                })
            table.append({'uuid': service.uuid.to_hex_str('-').lower(), 'characteristics': characteristics})
        return table

    async def subscribe(self, uuid):
        way = self.ways[uuid]
        await self.peer.subscribe(way, lambda value: say(value=bytes(value).hex(), of=uuid, phone=self.name))


class World:
    def __init__(self):
        self.link = LocalLink()
        self.phones = {}
        self.radios = {}

    def scanned(self, address):
        """What a radio answers to a scan request. The link in software has no such requests."""
        for controller, _ in self.radios.values():
            if controller.random_address == address:
                return AdvertisingData.from_bytes(bytes(controller.le_legacy_advertiser.scan_response_data))
        return AdvertisingData()

    async def do(self, order):
        do = order['do']
        phone = self.phones.get(order.get('phone'))
        if do == 'radio':
            # A controller for one insole; it listens for the insole's HCI.
            listener = socket.socket()
            listener.bind(('127.0.0.1', 0))
            transport = await open_tcp_server_transport_with_socket(listener)
            # Of another life, if any.
            if (old := self.radios.get(order['name'])) is not None:
                self.link.remove_controller(old[0])
                old[1].server.close()
                for phone in self.phones.values():
                    if phone.of(old[0]):
                        lose(phone.controller)
                        await phone.gone.wait()
            controller = Radio(order['name'], transport.source, transport.sink, link=self.link)
            self.radios[order['name']] = (controller, transport)
            return {'port': listener.getsockname()[1]}
        if do == 'phone':
            phone = self.phones[order['name']] = Phone(order['name'], order['address'], self.link)
            phone.bonds_as(order.get('bonding', True))
            await phone.device.power_on()
            return {}
        if do == 'scan':
            found = asyncio.get_running_loop().create_future()

            def heard(advertisement):
                name = self.scanned(advertisement.address).get(AdvertisingData.COMPLETE_LOCAL_NAME)
                if name == order['name'] and not found.done():
                    found.set_result(advertisement)

            phone.device.on('advertisement', heard)
            await phone.device.start_scanning(active=True)
            advertisement = await asyncio.wait_for(found, PATIENCE_S)
            await phone.device.stop_scanning()
            phone.device.remove_listener('advertisement', heard)
            return {'address': str(advertisement.address), 'data': bytes(advertisement.data).hex()}
        if do == 'connect':
            await phone.connect(order['address'])
            return {}
        if do == 'mtu':
            return {'mtu': await phone.peer.request_mtu(order['mtu'])}
        if do == 'discover':
            return {'table': await phone.discover()}
        if do == 'read':
            return {'value': bytes(await phone.peer.gatt_client.read_value(phone.ways[order['of']])).hex()}
        if do == 'write':
            await phone.peer.gatt_client.write_value(phone.ways[order['of']], bytes.fromhex(order['value']), True)
            return {}
        if do == 'subscribe':
            await phone.subscribe(order['to'])
            return {}
        if do == 'pair':
            await asyncio.wait_for(phone.connection.pair(), PATIENCE_S)
            return {}
        if do == 'encrypt':
            await asyncio.wait_for(phone.connection.encrypt(), PATIENCE_S)
            return {}
        if do == 'forget':
            await phone.device.keystore.delete_all()
            return {}
        if do == 'spoil_key':
            for name, keys in await phone.device.keystore.get_all():
                keys.ltk = PairingKeys.Key(bytes(16), authenticated=False)
                await phone.device.keystore.update(name, keys)
            return {}
        if do == 'disconnect':
            await phone.connection.disconnect()
            await phone.gone.wait()
            return {}
        if do == 'mute':
            # Indications are not confirmed on this connection.
            phone.peer.gatt_client.on_att_handle_value_indication = lambda _: None
            return {}
        if do == 'cut':
            # Both ends notice; no word passes between them.
            for controller, _ in self.radios.values():
                if phone.of(controller):
                    lose(controller)
            lose(phone.controller)
            await phone.gone.wait()
            return {}
        raise ValueError(f'no such order: {do}')


async def main():
    # The link in software warns of what a broken link leaves in the air.
    logging.disable(logging.WARNING)
    loop = asyncio.get_running_loop()
    reader = asyncio.StreamReader()
    await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), sys.stdin)
    world = World()
    while line := await reader.readline():
        order = json.loads(line)
        try:
            say(did=order['do'], **await asyncio.wait_for(world.do(order), 2 * PATIENCE_S))
        except ProtocolError as error:
            say(did=order['do'], error=str(error), att=error.error_code if isinstance(error, ATT_Error) else None)
        # An order whose connection ends is cancelled.
        except (Exception, asyncio.CancelledError) as error:  # pylint: disable=broad-except
            say(did=order['do'], error=f'{type(error).__name__}: {error}')


asyncio.run(main())
