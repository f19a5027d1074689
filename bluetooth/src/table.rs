//! The GATT table.

use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use plantar::firmware::ble::GattServer;
use plantar::protocol::gatt::{self, GattChannel};
use trouble_host::prelude::*;

const ATTRIBUTES: usize = 40;

/// A characteristic of which the table stores no value.
type Stream = Characteristic<[u8; 0]>;
pub type Server<'v> = AttributeServer<'v, NoopRawMutex, DefaultPacketPool, ATTRIBUTES, 1>;

/// The characteristics in the table.
pub struct Table {
    pub battery: Characteristic<u8>,
    pub time: Characteristic<[u8; 10]>,
    cadence: Stream,
    control: Stream,
    live: Stream,
    steps: Stream,
    parameters: Stream,
}

impl Table {
    pub fn build(insole: &dyn GattServer) -> (Self, Server<'_>) {
        use CharacteristicProp::{Indicate, Notify, Read, Write};
        use trouble_host::prelude::{characteristic as c, service as s};
        let mut table = AttributeTable::new();
        let appearance = &appearance::running_walking_sensor::IN_SHOE_RUNNING_WALKING_SENSOR;
        // The name is short enough.
        let _ = GapConfig::Peripheral(PeripheralConfig { name: insole.name(), appearance }).build(&mut table);

        let mut information = table.add_service(Service::new(s::DEVICE_INFORMATION));
        information.add_characteristic_ro(c::MANUFACTURER_NAME_STRING, "Plantar").build();
        information.add_characteristic_ro(c::MODEL_NUMBER_STRING, insole.model()).build();
        information.add_characteristic_ro(c::FIRMWARE_REVISION_STRING, insole.firmware()).build();
        let mut battery = table.add_service(Service::new(s::BATTERY));
        let battery = battery.add_characteristic_small(c::BATTERY_LEVEL, [Read], 0u8).build();
        let mut time = table.add_service(Service::new(s::CURRENT_TIME));
        let time = time.add_characteristic_small(c::CURRENT_TIME, [Read, Write, Notify], [0; 10]).build();
        let mut running = table.add_service(Service::new(s::RUNNING_SPEED_AND_CADENCE));
        let cadence = running.add_characteristic_small(c::RSC_MEASUREMENT, [Notify], []).build();
        // No optional features.
        running.add_characteristic_ro(c::RSC_FEATURE, &[0u8; 2]).build();
        // The insole service comes last: everything from its first handle on needs a bond.
        let mut ours = table.add_service(Service::new(Uuid::from(gatt::SERVICE)));
        let mut stream = |uuid: u128, props: &[CharacteristicProp]| {
            ours.add_characteristic_small(Uuid::from(uuid), props, []).build()
        };
        let control = stream(gatt::CONTROL, &[Write, Indicate]);
        let live = stream(gatt::LIVE, &[Notify]);
        let steps = stream(gatt::STEPS, &[Notify]);
        let parameters = stream(gatt::PARAMETERS, &[Write, Indicate]);
        (Self { battery, time, cadence, control, live, steps, parameters }, AttributeServer::new(table))
    }

    /// True for handles that only a bonded central on an encrypted link may write, subscriptions included.
    pub fn is_guarded(&self, handle: u16) -> bool {
        handle == self.time.handle || Some(handle) == self.time.cccd_handle || handle >= self.control.handle
    }

    /// The application's characteristic with this value handle.
    pub fn written(&self, handle: u16) -> Option<GattChannel> {
        let channels = [(&self.control, GattChannel::Control), (&self.parameters, GattChannel::Parameters)];
        match channels.into_iter().find(|(stream, _)| stream.handle == handle) {
            Some((_, channel)) => Some(channel),
            None => (self.time.handle == handle).then_some(GattChannel::Time),
        }
    }

    /// The characteristic that values are sent on. Current Time has another type.
    pub fn sent(&self, channel: GattChannel) -> &Stream {
        match channel {
            GattChannel::Cadence | GattChannel::Time => &self.cadence,
            GattChannel::Control => &self.control,
            GattChannel::Live => &self.live,
            GattChannel::Steps => &self.steps,
            GattChannel::Parameters => &self.parameters,
        }
    }
}
