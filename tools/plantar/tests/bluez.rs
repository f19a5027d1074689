//! A simulation of BlueZ, Linux's Bluetooth service, on a private D-Bus.

use std::collections::HashMap;
use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::mpsc::Receiver;
use tempfile::TempDir;
use zbus::blocking::{Connection, connection};
use zbus::fdo;
use zbus::interface;
use zbus::zvariant::{ObjectPath, OwnedValue, Value};

const ADAPTER: &str = "/org/bluez/hci0";
const DEVICE: &str = "/org/bluez/hci0/dev_C0_00_00_00_00_01";
const SERVICE: &str = "/org/bluez/hci0/dev_C0_00_00_00_00_01/service0010";
/// The GATT characteristics of docs/bluetooth.md: the number in the UUID, and the properties.
const CHARACTERISTICS: [(u8, &[&str]); 4] =
    [(1, &["write", "indicate"]), (2, &["notify"]), (3, &["notify"]), (4, &["write", "indicate"])];
/// Length of the longest value that the smallest ATT MTU allows, bytes.
pub const FRAGMENT: usize = 20;

/// The UUID of the service (0) or of a characteristic.
pub fn uuid(number: u8) -> String {
    format!("dca8c3{number:02x}-cb96-463f-8bec-f2094e1ccf7b")
}

/// The D-Bus path of a characteristic.
fn path(number: u8) -> String {
    format!("{SERVICE}/char{:04x}", 0x10 + number)
}

/// The values that an insole sends, each with the number of its characteristic.
pub type Values = Receiver<(u8, Vec<u8>)>;

/// The insole in range of the computer.
pub trait Peripheral: Send + Sync + 'static {
    /// The name that it advertises.
    fn name(&self) -> &str;

    /// Connects to the insole, and encrypts the link.
    fn connect(&self) -> Result<(), String>;

    /// Ends the connection.
    fn disconnect(&self);

    /// True while the computer is connected.
    fn is_connected(&self) -> bool;

    /// Subscribes to the characteristic with this number.
    fn subscribe(&self, number: u8) -> Result<(), String>;

    /// Writes a value to a characteristic.
    fn write(&self, number: u8, value: &[u8]) -> Result<(), String>;
}

struct Adapter;

#[interface(name = "org.bluez.Adapter1")]
impl Adapter {
    fn set_discovery_filter(&self, _filter: HashMap<String, OwnedValue>) {}
    fn start_discovery(&self) {}
    fn stop_discovery(&self) {}
    #[zbus(property)]
    fn address(&self) -> &str {
        "C0:00:00:00:00:00"
    }
    #[zbus(property)]
    fn address_type(&self) -> &str {
        "public"
    }
    #[zbus(property)]
    fn name(&self) -> &str {
        "computer"
    }
    #[zbus(property)]
    fn alias(&self) -> &str {
        "computer"
    }
    #[zbus(property)]
    fn modalias(&self) -> &str {
        "usb:v1D6Bp0246d0542"
    }
    #[zbus(property)]
    fn powered(&self) -> bool {
        true
    }
    #[zbus(property)]
    fn set_powered(&self, _powered: bool) {}
    #[zbus(property)]
    fn discovering(&self) -> bool {
        true
    }
}

struct Device(Arc<dyn Peripheral>);

#[interface(name = "org.bluez.Device1")]
impl Device {
    fn connect(&mut self) -> fdo::Result<()> {
        self.0.connect().map_err(fdo::Error::Failed)
    }
    fn disconnect(&mut self) {
        self.0.disconnect();
    }
    #[zbus(property)]
    fn adapter(&self) -> ObjectPath<'_> {
        ObjectPath::from_static_str_unchecked(ADAPTER)
    }
    #[zbus(property)]
    fn address(&self) -> &str {
        "C0:00:00:00:00:01"
    }
    #[zbus(property)]
    fn address_type(&self) -> &str {
        "random"
    }
    #[zbus(property)]
    fn name(&self) -> &str {
        self.0.name()
    }
    #[zbus(property, name = "UUIDs")]
    fn uuids(&self) -> Vec<String> {
        vec![uuid(0)]
    }
    #[zbus(property)]
    fn connected(&self) -> bool {
        self.0.is_connected()
    }
    #[zbus(property)]
    fn services_resolved(&self) -> bool {
        self.0.is_connected()
    }
    #[zbus(property, name = "RSSI")]
    fn rssi(&self) -> i16 {
        -60
    }
    #[zbus(property)]
    fn paired(&self) -> bool {
        true
    }
    #[zbus(property)]
    fn trusted(&self) -> bool {
        false
    }
    #[zbus(property)]
    fn blocked(&self) -> bool {
        false
    }
    #[zbus(property)]
    fn legacy_pairing(&self) -> bool {
        false
    }
}

struct Service;

#[interface(name = "org.bluez.GattService1")]
impl Service {
    #[zbus(property, name = "UUID")]
    fn uuid(&self) -> String {
        uuid(0)
    }
    #[zbus(property)]
    fn primary(&self) -> bool {
        true
    }
    #[zbus(property)]
    fn device(&self) -> ObjectPath<'_> {
        ObjectPath::from_static_str_unchecked(DEVICE)
    }
}

struct Characteristic {
    number: u8,
    flags: &'static [&'static str],
    insole: Arc<dyn Peripheral>,
}

#[interface(name = "org.bluez.GattCharacteristic1")]
impl Characteristic {
    fn start_notify(&self) -> fdo::Result<()> {
        self.insole.subscribe(self.number).map_err(fdo::Error::AccessDenied)
    }
    fn stop_notify(&self) {}
    fn write_value(&mut self, value: Vec<u8>, _options: HashMap<String, OwnedValue>) -> fdo::Result<()> {
        assert!(value.len() <= FRAGMENT);
        self.insole.write(self.number, &value).map_err(fdo::Error::Failed)
    }
    #[zbus(property, name = "UUID")]
    fn uuid(&self) -> String {
        uuid(self.number)
    }
    #[zbus(property)]
    fn service(&self) -> ObjectPath<'_> {
        ObjectPath::from_static_str_unchecked(SERVICE)
    }
    #[zbus(property)]
    fn flags(&self) -> Vec<&str> {
        self.flags.to_vec()
    }
    #[zbus(property)]
    fn notifying(&self) -> bool {
        false
    }
}

/// A private D-Bus with the Bluetooth service. Both run until the value is dropped.
pub struct Bus {
    daemon: Child,
    address: String,
    _service: Connection,
    /// The programs that use this bus place their lock files here.
    folder: TempDir,
}

impl Drop for Bus {
    fn drop(&mut self) {
        // This fails if the daemon has already exited.
        let _ = self.daemon.kill();
        let _ = self.daemon.wait();
    }
}

impl Bus {
    /// Starts a bus with this insole in range, or with none. The bus passes on the `values` that the insole sends.
    pub fn start(insole: Option<Arc<dyn Peripheral>>, values: Values) -> Self {
        let arguments = ["--session", "--nofork", "--print-address"];
        let daemon = Command::new("dbus-daemon").args(arguments).stdout(Stdio::piped()).stderr(Stdio::null()).spawn();
        let mut daemon = daemon.expect("dbus-daemon starts; `cargo xtask setup` installs it");
        let mut address = String::new();
        BufReader::new(daemon.stdout.take().expect("piped")).read_line(&mut address).expect("an address");
        let service = serve(address.trim(), insole);
        let signals = service.clone();
        std::thread::spawn(move || {
            for (number, value) in values {
                let changed = HashMap::from([("Value", Value::from(value))]);
                let body = ("org.bluez.GattCharacteristic1", changed, Vec::<&str>::new());
                let interface = "org.freedesktop.DBus.Properties";
                // This fails once the D-Bus daemon has ended.
                let _ = signals.emit_signal(None::<&str>, path(number), interface, "PropertiesChanged", &body);
            }
        });
        let folder = tempfile::tempdir().expect("a folder");
        Self { daemon, address: address.trim().into(), _service: service, folder }
    }

    /// The environment in which the command line uses this bus instead of the system's.
    pub fn environment(&self) -> [(&'static str, &str); 2] {
        let folder = self.folder.path().to_str().expect("a path in UTF-8");
        [("DBUS_SYSTEM_BUS_ADDRESS", &self.address), ("TMPDIR", folder)]
    }
}

/// Offers the Bluetooth service on the D-Bus at this address, with the insole that is in range.
fn serve(address: &str, insole: Option<Arc<dyn Peripheral>>) -> Connection {
    let mut builder = connection::Builder::address(address)
        .and_then(|b| b.name("org.bluez"))
        .and_then(|b| b.serve_at("/", fdo::ObjectManager))
        .and_then(|b| b.serve_at(ADAPTER, Adapter))
        .expect("paths");
    if let Some(insole) = insole {
        builder =
            builder.serve_at(DEVICE, Device(insole.clone())).and_then(|b| b.serve_at(SERVICE, Service)).expect("paths");
        for (number, flags) in CHARACTERISTICS {
            let characteristic = Characteristic { number, flags, insole: insole.clone() };
            builder = builder.serve_at(path(number), characteristic).expect("a path");
        }
    }
    builder.build().expect("the bus")
}
