//! The GATT table.

use crate::{Insole, Way};
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use trouble_host::prelude::*;

/// Our service and, with other numbers, its characteristics: `dca8c3xx-cb96-463f-8bec-f2094e1ccf7b`, drawn at random.
const fn uuid(number: u128) -> u128 {
    0xdca8_c300_cb96_463f_8bec_f209_4e1c_cf7b + (number << 96)
}

/// Our service.
pub const SERVICE: u128 = uuid(0);

const ATTRIBUTES: usize = 40;

/// A characteristic whose values are not kept in the table.
type Stream = Characteristic<[u8; 0]>;
pub type Server<'v> = AttributeServer<'v, NoopRawMutex, DefaultPacketPool, ATTRIBUTES, 1>;

/// Where things are in the table.
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
    pub fn build(insole: &dyn Insole) -> (Self, Server<'_>) {
        use CharacteristicProp::{Indicate, Notify, Read, Write};
        use trouble_host::prelude::{characteristic as c, service as s};
        let mut table = AttributeTable::new();
        let appearance = &appearance::running_walking_sensor::IN_SHOE_RUNNING_WALKING_SENSOR;
        // The name is no longer than it may be.
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
        // No feature beyond the cadence.
        running.add_characteristic_ro(c::RSC_FEATURE, &[0u8; 2]).build();
        // Ours comes last: what follows its first handle needs a bond.
        let mut ours = table.add_service(Service::new(Uuid::from(SERVICE)));
        let mut stream = |number, props: &[CharacteristicProp]| {
            ours.add_characteristic_small(Uuid::from(uuid(number)), props, []).build()
        };
        let control = stream(1, &[Write, Indicate]);
        let live = stream(2, &[Notify]);
        let steps = stream(3, &[Notify]);
        let parameters = stream(4, &[Write, Indicate]);
        (Self { battery, time, cadence, control, live, steps, parameters }, AttributeServer::new(table))
    }

    /// True for what only a bonded phone on an encrypted link may write, subscriptions included.
    pub fn is_guarded(&self, handle: u16) -> bool {
        handle == self.time.handle || Some(handle) == self.time.cccd_handle || handle >= self.control.handle
    }

    /// The application's characteristic with this handle of a value.
    pub fn written(&self, handle: u16) -> Option<Way> {
        let ways = [(&self.control, Way::Control), (&self.parameters, Way::Parameters)];
        match ways.into_iter().find(|(stream, _)| stream.handle == handle) {
            Some((_, way)) => Some(way),
            None => (self.time.handle == handle).then_some(Way::Time),
        }
    }

    /// The characteristic that values go out on. Current Time has its own.
    pub fn sent(&self, way: Way) -> &Stream {
        match way {
            Way::Cadence | Way::Time => &self.cadence,
            Way::Control => &self.control,
            Way::Live => &self.live,
            Way::Steps => &self.steps,
            Way::Parameters => &self.parameters,
        }
    }
}
