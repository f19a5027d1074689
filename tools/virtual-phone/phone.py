"""Simulates phones and Bluetooth controllers, for tests of the insole's Bluetooth.

Each line of input and output is a JSON object. A line of input is a command with its arguments, {"do": <command>, ...}.
For each command, in the same order, a line of output has the result, {"did": <command>, ...}. If the command failed, the
result has "error" with a message. If an answer of the attribute protocol reported the error, "att" has its code. Other lines of
output report events: {"value": <value>, "of": <uuid>, "phone": <name>} for each notification and indication, and
{"lost": <reason>, "phone": <name>} for each connection that ends, with the HCI error code as its reason. Values are in hex,
characteristics are given by UUID.

These commands create simulated devices:

    radio       Replaces or adds the controller `name` of an insole. Returns the TCP `port` for the insole's HCI.
    phone       Adds the phone `name` with an `address`. It bonds when it pairs, unless `bonding` is false.
    computer    Adds the controller of a computer. Returns the TCP `port` for the HCI of a program on it.

All other commands have the argument `phone`, the name of the phone that executes the command:

    scan        Finds the insole that advertises as `name`. Returns its `address` and the advertising `data`.
    connect     Connects to `address`.
    mtu         Requests an ATT MTU of `mtu` bytes. Returns the `mtu` in use.
    discover    Discovers the GATT table. Returns it as `table`.
    read        Reads the characteristic `of`. Returns its `value`.
    write       Writes `value` to the characteristic `of`.
    command     Writes `value` to the characteristic `of` without a response, and at once reads `of`. Returns the `value` that
                was read. An error in response to the command counts as the response to the read request.
    packets     Sends each of the `contents`, valid or not, as a packet on the L2CAP channel with the number `channel`, until the
                insole disconnects.
    subscribe   Subscribes to the characteristic `to`.
    pair        Pairs with the insole.
    requested_link
                Waits until the insole requests a link. Returns it as `link`: the shortest and the longest interval (1.25 ms),
                the latency (connection events) and the supervision timeout (10 ms).
    encrypt     Encrypts the connection with the key of the bond.
    forget      Deletes the phone's bonds.
    spoil_key   Replaces the keys of the phone's bonds by wrong ones.
    mute        Stops confirming indications on this connection.
    disconnect  Ends the connection.
    cut         Breaks the link, as if the phone were out of range.
"""

import asyncio
import json
import logging
import socket
import sys

from bumble.att import ATT_Error
from bumble.controller import Controller
from bumble.core import AdvertisingData, ProtocolError
from bumble.device import Device, Peer
from bumble.hci import (
    HCI_CONNECTION_TIMEOUT_ERROR,
    Address,
    HCI_Command_Complete_Event,
    HCI_ErrorCode,
    HCI_LE_Connection_Complete_Event,
    HCI_LE_Enhanced_Connection_Complete_Event,
    HCI_Reset_Command,
    HCI_StatusReturnParameters,
    OwnAddressType,
)
from bumble.host import Host
from bumble.keys import MemoryKeyStore, PairingKeys
from bumble.l2cap import L2CAP_Connection_Parameter_Update_Response
from bumble.link import LocalLink
from bumble.pairing import PairingConfig, PairingDelegate
from bumble.transport.common import AsyncPipeSink, PacketParser
from bumble.transport.tcp_server import open_tcp_server_transport_with_socket

# Longest wait for one event within a command.
TIMEOUT_S = 20
# Time after the command to reset the controller in which the insole sends nothing, because it waits for the result.
RESET_SILENCE_S = 0.2


def write(**message):
    """Writes one line of output."""
    print(json.dumps(message), flush=True)


class InsoleParser(PacketParser):
    """Parses the packets of an insole. A restart of the insole may cut a packet.

    On a board, the restart also resets the controller. Here the first command after the restart, which resets the controller,
    would be taken for a part of the incomplete packet. If nothing follows this command, the parser discards the incomplete
    packet and executes the command.
    """

    RESET = bytes(HCI_Reset_Command())

    def __init__(self):
        super().__init__(self)
        self.controller = None
        # The last received bytes, as many as the command to reset the controller has.
        self.tail = b''
        # The last complete packet of the bytes that were fed last.
        self.last_packet = b''
        self.timer = None

    def set_packet_sink(self, sink):
        self.controller = sink

    def on_packet(self, packet):
        self.last_packet = packet
        self.controller.on_packet(packet)

    def feed_data(self, data):
        if self.timer is not None:
            self.timer.cancel()
        self.tail = (self.tail + data)[-len(self.RESET):]
        self.last_packet = b''
        try:
            super().feed_data(data)
        finally:
            if self.tail == self.RESET != self.last_packet:
                self.timer = asyncio.get_running_loop().call_later(RESET_SILENCE_S, self.end_cut_packet)

    def end_cut_packet(self):
        self.reset()
        super().feed_data(self.RESET)


def drop_connections(controller):
    """Ends a controller's connections as if the peers were out of range."""
    for connection in list(controller.le_connections.values()):
        controller.on_le_disconnected(connection, HCI_CONNECTION_TIMEOUT_ERROR)


class Radio(Controller):
    """The Bluetooth controller of an insole. It generates private addresses, which bumble's controller does not."""

    # The insole's permanent address, by which bonded phones identify the insole.
    identity_address = None
    # The insole's present private address. A real controller replaces it every 15 minutes, this one after each restart.
    private_address = None

    def has_address(self, address):
        """True for the address that is in use, and for the insole's identity address."""
        return address in (self.random_address, self.identity_address)

    def on_hci_le_set_random_address_command(self, command):
        """Stores the identity address."""
        self.identity_address = command.random_address
        return super().on_hci_le_set_random_address_command(command)

    def on_hci_le_add_device_to_resolving_list_command(self, command):
        """Generates a private address from the insole's key."""
        if any(command.local_irk) and self.private_address is None:
            self.private_address = Address.generate_private_address(bytes(command.local_irk))
        return super().on_hci_le_add_device_to_resolving_list_command(command)

    def on_hci_le_set_advertising_enable_command(self, command):
        """Advertises with the private address if the insole requests it and has set its key.

        Otherwise, the controller advertises with the identity address.
        """
        wants_private = self.le_legacy_advertiser.own_address_type in (
            OwnAddressType.RESOLVABLE_OR_PUBLIC,
            OwnAddressType.RESOLVABLE_OR_RANDOM,
        )
        if command.advertising_enable:
            self.random_address = self.private_address if wants_private and self.private_address else self.identity_address
        return super().on_hci_le_set_advertising_enable_command(command)

    def send_hci_packet(self, packet):
        """Adds the insole's private address to the event of a new connection."""
        if isinstance(packet, HCI_LE_Connection_Complete_Event) and self.random_address == self.private_address:
            packet = HCI_LE_Enhanced_Connection_Complete_Event(
                status=packet.status,
                connection_handle=packet.connection_handle,
                role=packet.role,
                peer_address_type=packet.peer_address_type,
                peer_address=packet.peer_address,
                local_resolvable_private_address=self.random_address,
                peer_resolvable_private_address=Address('00:00:00:00:00:00'),
                connection_interval=packet.connection_interval,
                peripheral_latency=packet.peripheral_latency,
                supervision_timeout=packet.supervision_timeout,
                central_clock_accuracy=packet.central_clock_accuracy,
            )
        super().send_hci_packet(packet)

    def on_hci_reset_command(self, command):
        """Ends all connections without a message to the peers, as a controller does when its insole restarts.

        bumble leaves the connections as they are.
        """
        self.private_address = None
        self.le_connections.clear()
        for controller in self.link.controllers:
            for connection in list(controller.le_connections.values()):
                if self.has_address(connection.peer_address):
                    controller.on_le_disconnected(connection, HCI_CONNECTION_TIMEOUT_ERROR)
        return super().on_hci_reset_command(command)

    def on_hci_le_remove_device_from_resolving_list_command(self, command):
        """Confirms this command, which bumble does not implement."""
        self.send_hci_packet(
            HCI_Command_Complete_Event(
                num_hci_command_packets=1,
                command_opcode=command.op_code,
                return_parameters=HCI_StatusReturnParameters(HCI_ErrorCode.SUCCESS),
            )
        )


class Phone:
    """A phone with at most one connection."""

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
        self.disconnected = asyncio.Event()
        self.peer = None
        # The characteristics of the insole by UUID.
        self.characteristics = {}
        # The link that the insole requests, in the units of the request. The simulated link has no intervals, so it does not
        # change.
        self.requested_link = asyncio.Queue()
        channels = self.device.l2cap_channel_manager
        channels.on_l2cap_connection_parameter_update_request = self.on_requested_link

    def on_requested_link(self, connection, channel, request):
        """Accepts the link that the insole requests."""
        response = L2CAP_Connection_Parameter_Update_Response(identifier=request.identifier, result=0)
        self.device.l2cap_channel_manager.send_control_frame(connection, channel, response)
        self.requested_link.put_nowait([request.interval_min, request.interval_max, request.latency, request.timeout])

    def set_bonding(self, bonding):
        """Sets whether the phone bonds when it pairs."""
        delegate = PairingDelegate(PairingDelegate.NO_OUTPUT_NO_INPUT)
        self.device.pairing_config_factory = lambda _: PairingConfig(
            sc=True,
            mitm=False,
            bonding=bonding,
            delegate=delegate,
            identity_address_type=PairingConfig.AddressType.RANDOM,
        )

    async def connect(self, address):
        """Connects to an address."""
        self.disconnected.clear()
        self.connection = await self.device.connect(Address(address), timeout=TIMEOUT_S)
        self.connection.on('disconnection', self.lost)
        self.peer = Peer(self.connection)
        # Like a real phone, this one caches the insole's GATT table and uses it again in the new connection.
        for characteristic in self.characteristics.values():
            characteristic.client = self.peer.gatt_client

    def lost(self, reason):
        """Reports the end of the connection."""
        write(lost=int(reason), phone=self.name)
        self.connection = None
        self.disconnected.set()

    def is_connected_to(self, radio):
        """True for a phone that is connected to this controller."""
        return self.connection is not None and radio.has_address(self.connection.peer_address)

    async def discover(self):
        """Discovers the GATT table and returns it."""
        await self.peer.discover_services()
        table = []
        self.characteristics = {}
        for service in self.peer.services:
            characteristics = []
            await service.discover_characteristics()
            for characteristic in service.characteristics:
                await characteristic.discover_descriptors()
                uuid = characteristic.uuid.to_hex_str('-').lower()
                self.characteristics[uuid] = characteristic
                characteristics.append({
                    'uuid': uuid,
                    'handle': characteristic.handle,
                    'properties': int(characteristic.properties),
                    'descriptors': [d.type.to_hex_str('-').lower() for d in characteristic.descriptors],
                })
            table.append({'uuid': service.uuid.to_hex_str('-').lower(), 'characteristics': characteristics})
        return table

    async def subscribe(self, uuid):
        """Subscribes to a characteristic, and writes its values to the output."""
        characteristic = self.characteristics[uuid]
        await self.peer.subscribe(
            characteristic,
            lambda value: write(value=bytes(value).hex(), of=uuid, phone=self.name),
        )


class World:
    """All phones and controllers, and the simulated link between them."""

    def __init__(self):
        self.link = LocalLink()
        self.phones = {}
        self.radios = {}
        self.computers = []

    def scan_response(self, address):
        """The scan response of the controller with this address.

        The simulated link has no scan requests, so the response is read from the controller itself.
        """
        for controller, _ in self.radios.values():
            if controller.random_address == address:
                return AdvertisingData.from_bytes(bytes(controller.le_legacy_advertiser.scan_response_data))
        return AdvertisingData()

    async def execute(self, command):
        """Executes a command. Returns the values of its result."""
        do = command['do']
        phone = self.phones.get(command.get('phone'))
        if do == 'radio':
            # The controller listens on a TCP port for the HCI packets of its insole.
            listener = socket.socket()
            listener.bind(('127.0.0.1', 0))
            transport = await open_tcp_server_transport_with_socket(listener)
            transport.source.parser = InsoleParser()
            # Removes the controller of the insole's previous run, if there is one.
            if (previous := self.radios.get(command['name'])) is not None:
                previous_controller, previous_transport = previous
                self.link.remove_controller(previous_controller)
                previous_transport.server.close()
                for phone in self.phones.values():
                    if phone.is_connected_to(previous_controller):
                        drop_connections(phone.controller)
                        await phone.disconnected.wait()
            controller = Radio(command['name'], transport.source, transport.sink, link=self.link)
            self.radios[command['name']] = (controller, transport)
            return {'port': listener.getsockname()[1]}
        if do == 'computer':
            listener = socket.socket()
            listener.bind(('127.0.0.1', 0))
            transport = await open_tcp_server_transport_with_socket(listener)
            self.computers.append(Controller('computer', transport.source, transport.sink, link=self.link))
            return {'port': listener.getsockname()[1]}
        if do == 'phone':
            phone = self.phones[command['name']] = Phone(command['name'], command['address'], self.link)
            phone.set_bonding(command.get('bonding', True))
            await phone.device.power_on()
            return {}
        if do == 'scan':
            found = asyncio.get_running_loop().create_future()

            def on_advertisement(advertisement):
                name = self.scan_response(advertisement.address).get(AdvertisingData.COMPLETE_LOCAL_NAME)
                if name == command['name'] and not found.done():
                    found.set_result(advertisement)

            phone.device.on('advertisement', on_advertisement)
            await phone.device.start_scanning(active=True)
            try:
                advertisement = await asyncio.wait_for(found, TIMEOUT_S)
            finally:
                await phone.device.stop_scanning()
                phone.device.remove_listener('advertisement', on_advertisement)
            return {'address': str(advertisement.address), 'data': bytes(advertisement.data).hex()}
        if do == 'connect':
            await phone.connect(command['address'])
            return {}
        if do == 'mtu':
            return {'mtu': await phone.peer.request_mtu(command['mtu'])}
        if do == 'discover':
            return {'table': await phone.discover()}
        if do == 'read':
            return {'value': bytes(await phone.peer.gatt_client.read_value(phone.characteristics[command['of']])).hex()}
        if do == 'write':
            characteristic = phone.characteristics[command['of']]
            await phone.peer.gatt_client.write_value(characteristic, bytes.fromhex(command['value']), True)
            return {}
        if do == 'command':
            characteristic = phone.characteristics[command['of']]
            await phone.peer.gatt_client.write_value(characteristic, bytes.fromhex(command['value']), False)
            return {'value': bytes(await phone.peer.gatt_client.read_value(characteristic)).hex()}
        if do == 'packets':
            # Content of the channel, without a check by bumble, until the insole disconnects.
            for content in command['contents']:
                if phone.connection is None:
                    break
                phone.connection.send_l2cap_pdu(command['channel'], bytes.fromhex(content))
                await asyncio.sleep(0)
            return {}
        if do == 'subscribe':
            await phone.subscribe(command['to'])
            return {}
        if do == 'pair':
            await asyncio.wait_for(phone.connection.pair(), TIMEOUT_S)
            return {}
        if do == 'requested_link':
            return {'link': await asyncio.wait_for(phone.requested_link.get(), TIMEOUT_S)}
        if do == 'encrypt':
            await asyncio.wait_for(phone.connection.encrypt(), TIMEOUT_S)
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
            await phone.disconnected.wait()
            return {}
        if do == 'mute':
            # bumble confirms an indication in this handler.
            phone.peer.gatt_client.on_att_handle_value_indication = lambda _: None
            return {}
        if do == 'listen':
            # Reports each notification, also of a characteristic to which the phone did not subscribe in this connection.
            phone.peer.gatt_client.on_att_handle_value_notification = lambda notification: write(
                notified=notification.attribute_handle, phone=phone.name
            )
            return {}
        if do == 'cut':
            # Both ends detect the loss of the link by themselves, without a message between them.
            for controller, _ in self.radios.values():
                if phone.is_connected_to(controller):
                    drop_connections(controller)
            drop_connections(phone.controller)
            await phone.disconnected.wait()
            return {}
        raise ValueError(f'unknown command: {do}')


async def main():
    # bumble would warn about packets that are in flight when a link breaks.
    logging.disable(logging.WARNING)
    loop = asyncio.get_running_loop()
    reader = asyncio.StreamReader()
    await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), sys.stdin)
    world = World()
    while line := await reader.readline():
        command = json.loads(line)
        try:
            write(did=command['do'], **await asyncio.wait_for(world.execute(command), 2 * TIMEOUT_S))
        except ProtocolError as error:
            write(did=command['do'], error=str(error), att=error.error_code if isinstance(error, ATT_Error) else None)
        # bumble cancels a command if its connection ends.
        except (Exception, asyncio.CancelledError) as error:  # pylint: disable=broad-except
            write(did=command['do'], error=f'{type(error).__name__}: {error}')


asyncio.run(main())
