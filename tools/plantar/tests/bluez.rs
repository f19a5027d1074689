//! A simulation of BlueZ, Linux's Bluetooth service, on a private D-Bus.

use dbus::Message;
use dbus::arg::{PropMap, RefArg, Variant};
use dbus::blocking::Connection;
use dbus::blocking::stdintf::org_freedesktop_dbus::PropertiesPropertiesChanged;
use dbus::channel::{MatchingReceiver, Sender};
use dbus::message::{MatchRule, SignalArgs};
use dbus::strings::Path;
use dbus_crossroads::{Crossroads, IfaceBuilder, IfaceToken, MethodErr};
use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::Receiver;
use std::thread::JoinHandle;
use std::time::Duration;
use tempfile::TempDir;

const ADAPTER: &str = "/org/bluez/hci0";
const DEVICE: &str = "/org/bluez/hci0/dev_C0_00_00_00_00_01";
const SERVICE: &str = "/org/bluez/hci0/dev_C0_00_00_00_00_01/service0010";
/// The GATT characteristics of docs/bluetooth.md: the number in the UUID, and the properties.
const CHARACTERISTICS: [(u8, &[&str]); 4] =
    [(1, &["write", "indicate"]), (2, &["notify"]), (3, &["notify"]), (4, &["write", "indicate"])];
/// Length of the opcode and the handle that precede a value in an ATT packet, bytes.
pub const ATT_HEADER: usize = 3;

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

    /// The ATT MTU of the connection, bytes.
    fn mtu(&self) -> u16;

    /// Subscribes to the characteristic with this number.
    fn subscribe(&self, number: u8) -> Result<(), String>;

    /// Writes a value to a characteristic.
    fn write(&self, number: u8, value: &[u8]) -> Result<(), String>;
}

/// Offers a property that never changes.
fn constant<T: Send + 'static, V>(interface: &mut IfaceBuilder<T>, name: &str, value: V)
where
    V: dbus::arg::Arg + dbus::arg::Append + RefArg + Clone + Send + 'static,
{
    interface.property(name).get(move |_, _| Ok(value.clone()));
}

/// The computer's Bluetooth adapter.
fn adapter(interface: &mut IfaceBuilder<()>) {
    interface.method("SetDiscoveryFilter", ("filter",), (), |_, (), (_,): (PropMap,)| Ok(()));
    interface.method("StartDiscovery", (), (), |_, (), ()| Ok(()));
    interface.method("StopDiscovery", (), (), |_, (), ()| Ok(()));
    constant(interface, "Address", "C0:00:00:00:00:00".to_owned());
    constant(interface, "AddressType", "public".to_owned());
    constant(interface, "Name", "computer".to_owned());
    constant(interface, "Alias", "computer".to_owned());
    constant(interface, "Modalias", "usb:v1D6Bp0246d0542".to_owned());
    interface.property("Powered").get(|_, ()| Ok(true)).set(|_, (), _| Ok(None));
    constant(interface, "Discovering", true);
}

/// An insole that the adapter has found.
fn device(interface: &mut IfaceBuilder<Arc<dyn Peripheral>>) {
    interface.method("Connect", (), (), |_, insole, ()| insole.connect().map_err(|error| MethodErr::failed(&error)));
    interface.method("Disconnect", (), (), |_, insole, ()| {
        insole.disconnect();
        Ok(())
    });
    constant(interface, "Adapter", Path::from(ADAPTER));
    constant(interface, "Address", "C0:00:00:00:00:01".to_owned());
    constant(interface, "AddressType", "random".to_owned());
    interface.property("Name").get(|_, insole| Ok(insole.name().to_owned()));
    constant(interface, "UUIDs", vec![uuid(0)]);
    interface.property("Connected").get(|_, insole| Ok(insole.is_connected()));
    interface.property("ServicesResolved").get(|_, insole| Ok(insole.is_connected()));
    constant(interface, "RSSI", -60_i16);
    // The client's library requires this property and the next three, but the client does not read them.
    constant(interface, "Paired", true);
    constant(interface, "Trusted", false);
    constant(interface, "Blocked", false);
    constant(interface, "LegacyPairing", false);
}

/// The GATT service of an insole.
fn service(interface: &mut IfaceBuilder<()>) {
    constant(interface, "UUID", uuid(0));
    constant(interface, "Primary", true);
    constant(interface, "Device", Path::from(DEVICE));
}

struct Characteristic {
    number: u8,
    flags: &'static [&'static str],
    insole: Arc<dyn Peripheral>,
}

/// The name of the interface of a GATT characteristic.
const CHARACTERISTIC: &str = "org.bluez.GattCharacteristic1";

/// A GATT characteristic of an insole.
fn characteristic(interface: &mut IfaceBuilder<Characteristic>) {
    interface.method("StartNotify", (), (), |_, this, ()| {
        let result = this.insole.subscribe(this.number);
        result.map_err(|error| ("org.freedesktop.DBus.Error.AccessDenied", error).into())
    });
    interface.method("StopNotify", (), (), |_, _, ()| Ok(()));
    interface.method("WriteValue", ("value", "options"), (), |_, this, (value, _): (Vec<u8>, PropMap)| {
        // BlueZ would write a longer value in parts, which an insole refuses.
        assert!(value.len() + ATT_HEADER <= usize::from(this.insole.mtu()));
        this.insole.write(this.number, &value).map_err(|error| MethodErr::failed(&error))
    });
    interface.property("UUID").get(|_, this| Ok(uuid(this.number)));
    interface.property("MTU").get(|_, this| Ok(this.insole.mtu()));
    constant(interface, "Service", Path::from(SERVICE));
    interface.property("Flags").get(|_, this| Ok(this.flags.iter().map(|&flag| flag.to_owned()).collect::<Vec<_>>()));
    constant(interface, "Notifying", false);
}

/// A private D-Bus with the Bluetooth service. Both run until the value is dropped.
pub struct Bus {
    daemon: Child,
    address: String,
    /// The thread of the Bluetooth service.
    service: Option<JoinHandle<()>>,
    /// True ends the Bluetooth service.
    end: Arc<AtomicBool>,
    /// The programs that use this bus place their lock files here.
    folder: TempDir,
}

impl Drop for Bus {
    fn drop(&mut self) {
        self.end.store(true, Ordering::Relaxed);
        // An error of the service was already reported when its thread panicked.
        let _ = self.service.take().map(JoinHandle::join);
        // This fails if the daemon has already exited.
        let _ = self.daemon.kill();
        let _ = self.daemon.wait();
    }
}

/// Longest time for which the service waits for a call before it sends the values of the insole.
const INTERVAL: Duration = Duration::from_millis(1);

impl Bus {
    /// Starts a bus with this insole in range, or with none. The bus passes on the `values` that the insole sends.
    pub fn start(insole: Option<Arc<dyn Peripheral>>, values: Values) -> Self {
        let arguments = ["--session", "--nofork", "--print-address"];
        let daemon = Command::new("dbus-daemon").args(arguments).stdout(Stdio::piped()).stderr(Stdio::null()).spawn();
        let mut daemon = daemon.expect("dbus-daemon starts; `cargo xtask setup` installs it");
        let mut address = String::new();
        BufReader::new(daemon.stdout.take().expect("piped")).read_line(&mut address).expect("an address");
        let address = address.trim().to_owned();
        let bus = connect(&address, insole);
        let end = Arc::new(AtomicBool::new(false));
        let ended = end.clone();
        let service = std::thread::spawn(move || {
            while !ended.load(Ordering::Relaxed) {
                bus.process(INTERVAL).expect("the D-Bus daemon runs");
                for (number, value) in values.try_iter() {
                    bus.send(changed(number, value)).expect("memory for a message");
                }
            }
        });
        let folder = tempfile::tempdir().expect("a folder");
        Self { daemon, address, service: Some(service), end, folder }
    }

    /// The environment in which the command line uses this bus instead of the system's.
    pub fn environment(&self) -> [(&'static str, &str); 2] {
        let folder = self.folder.path().to_str().expect("a path in UTF-8");
        [("DBUS_SYSTEM_BUS_ADDRESS", &self.address), ("TMPDIR", folder)]
    }
}

/// The message with a new value of a characteristic.
fn changed(number: u8, value: Vec<u8>) -> Message {
    let value: Box<dyn RefArg> = Box::new(value);
    let signal = PropertiesPropertiesChanged {
        interface_name: CHARACTERISTIC.to_owned(),
        changed_properties: [("Value".to_owned(), Variant(value))].into(),
        invalidated_properties: Vec::new(),
    };
    signal.to_emit_message(&path(number).into())
}

/// Connects the Bluetooth service, with the insole that is in range, to the D-Bus at this address.
fn connect(address: &str, insole: Option<Arc<dyn Peripheral>>) -> Connection {
    let mut objects = Crossroads::new();
    objects.insert("/", &[objects.object_manager()], ());
    let adapter = objects.register("org.bluez.Adapter1", adapter);
    objects.insert(ADAPTER, &[adapter], ());
    if let Some(insole) = insole {
        let device: IfaceToken<Arc<dyn Peripheral>> = objects.register("org.bluez.Device1", device);
        objects.insert(DEVICE, &[device], insole.clone());
        let service = objects.register("org.bluez.GattService1", service);
        objects.insert(SERVICE, &[service], ());
        let interface = objects.register(CHARACTERISTIC, characteristic);
        for (number, flags) in CHARACTERISTICS {
            objects.insert(path(number), &[interface], Characteristic { number, flags, insole: insole.clone() });
        }
    }
    let bus = Connection::new_address(address).expect("the D-Bus daemon runs");
    let calls = MatchRule::new_method_call();
    bus.start_receive(
        calls,
        Box::new(move |call, bus| {
            objects.handle_message(call, bus).expect("a method call");
            true
        }),
    );
    bus.request_name("org.bluez", false, false, true).expect("the name is free");
    bus
}
