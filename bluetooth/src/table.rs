//! The GATT table of `docs/bluetooth.md`.

use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use plantar::firmware::ble::GattServer;
use plantar::protocol::gatt::{self, GattChannel};
use trouble_host::prelude::*;

/// Largest number of attributes: those of a board that measures its battery and serves management tools.
const ATTRIBUTES: usize = 43;

/// A characteristic without a stored value: its values are sent or received when they occur.
type Stream = Characteristic<[u8; 0]>;
/// The attribute server of the Bluetooth host.
pub type Server<'v> = AttributeServer<'v, NoopRawMutex, DefaultPacketPool, ATTRIBUTES, 1>;
/// The attributes that the server offers.
pub type Attributes<'v> = AttributeTable<'v, NoopRawMutex, ATTRIBUTES>;

/// The characteristics with values that change.
pub struct Table {
    /// Battery Level, percent; `None` on a board that does not measure it.
    pub battery: Option<Characteristic<u8>>,
    /// Current Time.
    pub time: Characteristic<[u8; 10]>,
    cadence: Stream,
    control: Stream,
    live: Stream,
    steps: Stream,
    parameters: Stream,
    /// [`gatt::MANAGEMENT`]; `None` on a board that does not serve management tools.
    management: Option<Stream>,
}

impl Table {
    /// Adds the attributes, with the names and versions of the insole, to an empty table.
    pub fn build<'v>(table: &mut Attributes<'v>, insole: &'v dyn GattServer) -> Self {
        use CharacteristicProp::{Indicate, Notify, Read, Write, WriteWithoutResponse};
        use trouble_host::prelude::{characteristic as c, service as s};
        let appearance = &appearance::running_walking_sensor::IN_SHOE_RUNNING_WALKING_SENSOR;
        // This fails only if the name has more than 22 bytes, and the name of an insole is shorter.
        let _ = GapConfig::Peripheral(PeripheralConfig { name: insole.name(), appearance }).build(table);

        // A phone that has bonded may remember the handles, and there is no Service Changed. So the handles of the insole's
        // service never change: all services that can be missing or new follow it.
        let mut insole_service = table.add_service(Service::new(Uuid::from(gatt::SERVICE)));
        let mut stream = |uuid: u128, props: &[CharacteristicProp]| {
            insole_service.add_characteristic_small(Uuid::from(uuid), props, []).build()
        };
        let control = stream(gatt::CONTROL, &[Write, Indicate]);
        let live = stream(gatt::LIVE, &[Notify]);
        let steps = stream(gatt::STEPS, &[Notify]);
        let parameters = stream(gatt::PARAMETERS, &[Write, Indicate]);
        let management = insole.is_managed().then(|| {
            let mut tools = table.add_service(Service::new(Uuid::from(gatt::MANAGEMENT_SERVICE)));
            let props = [WriteWithoutResponse, Notify];
            tools.add_characteristic_small(Uuid::from(gatt::MANAGEMENT), props, []).build()
        });
        let mut time = table.add_service(Service::new(s::CURRENT_TIME));
        let time = time.add_characteristic_small(c::CURRENT_TIME, [Read, Write, Notify], [0; 10]).build();
        let mut running = table.add_service(Service::new(s::RUNNING_SPEED_AND_CADENCE));
        let cadence = running.add_characteristic_small(c::RSC_MEASUREMENT, [Notify], []).build();
        // The insole has no optional feature of Running Speed and Cadence.
        running.add_characteristic_ro(c::RSC_FEATURE, &[0u8; 2]).build();
        let mut information = table.add_service(Service::new(s::DEVICE_INFORMATION));
        information.add_characteristic_ro(c::MANUFACTURER_NAME_STRING, "Plantar").build();
        information.add_characteristic_ro(c::MODEL_NUMBER_STRING, insole.model()).build();
        information.add_characteristic_ro(c::FIRMWARE_REVISION_STRING, insole.firmware()).build();
        let battery = insole.battery_percent().map(|percent| {
            let mut battery = table.add_service(Service::new(s::BATTERY));
            battery.add_characteristic_small(c::BATTERY_LEVEL, [Read], percent).build()
        });
        Self { battery, time, cadence, control, live, steps, parameters, management }
    }

    /// True for handles that only a bonded central on an encrypted link may write: those of all values that can be written, and
    /// of all subscriptions. Subscriptions are included because a phone pairs only after a refusal: otherwise a generic app that
    /// only subscribes to the cadence would never pair, and would be disconnected after 30 s.
    pub fn is_guarded(&self, handle: u16) -> bool {
        handle >= self.control.handle
    }

    /// The channel of a value handle that a central may write; `None` for other handles.
    pub fn writable_channel(&self, handle: u16) -> Option<GattChannel> {
        let channels = [
            (Some(&self.control), GattChannel::Control),
            (Some(&self.parameters), GattChannel::Parameters),
            (self.management.as_ref(), GattChannel::Management),
        ];
        match channels.into_iter().find(|(stream, _)| stream.is_some_and(|stream| stream.handle == handle)) {
            Some((_, channel)) => Some(channel),
            None => (self.time.handle == handle).then_some(GattChannel::Time),
        }
    }

    /// The characteristic on which the values of a channel are sent. Current Time, which has another type, must be sent on
    /// [`Table::time`]; for its channel, the result is a placeholder.
    pub fn stream(&self, channel: GattChannel) -> &Stream {
        match channel {
            GattChannel::Cadence | GattChannel::Time => &self.cadence,
            GattChannel::Control => &self.control,
            GattChannel::Live => &self.live,
            GattChannel::Steps => &self.steps,
            GattChannel::Parameters => &self.parameters,
            // An insole sends no value of a characteristic that it does not have.
            GattChannel::Management => self.management.as_ref().unwrap_or(&self.control),
        }
    }
}
