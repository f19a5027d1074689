//! An emulated insole behind a simulated radio: bumble simulates the controllers of the insole and of this computer.

use crate::bluez::{Peripheral, Values, uuid};
use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Write};
use std::net::SocketAddr;
use std::path::Path;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};

/// The name of the simulated controller of this computer.
const COMPUTER: &str = "computer";
/// ATT MTU of the connection, bytes: the MTU of the insole, which is smaller than that of Linux.
const MTU: u16 = 247;

/// The radio between this computer and an insole.
pub struct Radio {
    python: Mutex<Child>,
    /// Requests to the simulation, and its results.
    requests: Mutex<(ChildStdin, Receiver<Value>)>,
    /// The name that the insole advertises.
    insole: &'static str,
    is_bonded: AtomicBool,
    is_connected: Arc<AtomicBool>,
}

impl Radio {
    /// Starts the simulation. Returns the radio, the address at which the simulated controller of the insole waits for the
    /// firmware's HCI, and the values that the insole sends.
    pub fn start(insole: &'static str) -> (Arc<Self>, SocketAddr, Values) {
        let interpreter = std::env::var_os("PLANTAR_PYTHON").expect("PLANTAR_PYTHON names a Python with bumble");
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../virtual-phone/phone.py");
        let mut command = Command::new(interpreter);
        command.arg(script).stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut python = command.spawn().expect("Python starts");
        let input = python.stdin.take().expect("piped");
        let output = BufReader::new(python.stdout.take().expect("piped"));
        let (results, received_results) = channel();
        let (values, received_values) = channel();
        let is_connected = Arc::<AtomicBool>::default();
        let connected = is_connected.clone();
        std::thread::spawn(move || {
            for line in output.lines().map_while(Result::ok) {
                let line = serde_json::from_str(&line).expect("the simulation writes JSON");
                pass_on(line, &results, &values, &connected);
            }
        });
        let radio = Self {
            python: Mutex::new(python),
            requests: Mutex::new((input, received_results)),
            insole,
            is_bonded: AtomicBool::new(false),
            is_connected,
        };
        let port = radio.request(json!({"do": "radio", "name": "insole"})).expect("a controller")["port"].as_u64();
        let address = ([127, 0, 0, 1], port.expect("a port") as u16).into();
        let computer = json!({"do": "phone", "name": COMPUTER, "address": "D0:00:00:00:00:01"});
        radio.request(computer).expect("a controller");
        (Arc::new(radio), address, received_values)
    }

    /// Sends a request to the simulation, and returns its result or its error.
    fn request(&self, request: Value) -> Result<Value, String> {
        let mut requests = self.requests.lock().unwrap_or_else(PoisonError::into_inner);
        writeln!(requests.0, "{request}").map_err(|error| error.to_string())?;
        let result = requests.1.recv().map_err(|error| error.to_string())?;
        match &result["error"] {
            Value::Null => Ok(result),
            error => Err(format!("{request}: {error}")),
        }
    }
}

/// Passes on a line of the simulation: the result of a request, a value of the insole, or the end of the connection.
fn pass_on(line: Value, results: &Sender<Value>, values: &Sender<(u8, Vec<u8>)>, is_connected: &AtomicBool) {
    // Sending fails only at the end of the test, when the receivers are dropped.
    if line.get("did").is_some() {
        let _ = results.send(line);
    } else if let (Some(of), Some(value)) = (line["of"].as_str(), line["value"].as_str()) {
        let number = (1..=4).find(|number| uuid(*number) == of).expect("a characteristic of the insole");
        let digits = (0..value.len()).step_by(2).map(|i| u8::from_str_radix(&value[i..i + 2], 16));
        let _ = values.send((number, digits.collect::<Result<_, _>>().expect("hexadecimal digits")));
    } else {
        is_connected.store(false, Ordering::SeqCst);
    }
}

impl Peripheral for Radio {
    fn name(&self) -> &str {
        self.insole
    }

    fn connect(&self) -> Result<(), String> {
        let found = self.request(json!({"do": "scan", "phone": COMPUTER, "name": self.insole}))?;
        self.request(json!({"do": "connect", "phone": COMPUTER, "address": found["address"]}))?;
        self.is_connected.store(true, Ordering::SeqCst);
        self.request(json!({"do": "mtu", "phone": COMPUTER, "mtu": MTU}))?;
        if self.is_bonded.swap(true, Ordering::SeqCst) {
            self.request(json!({"do": "encrypt", "phone": COMPUTER}))?;
        } else {
            self.request(json!({"do": "discover", "phone": COMPUTER}))?;
            self.request(json!({"do": "pair", "phone": COMPUTER}))?;
        }
        Ok(())
    }

    fn disconnect(&self) {
        // This fails if the insole has ended the connection.
        let _ = self.request(json!({"do": "disconnect", "phone": COMPUTER}));
    }

    fn is_connected(&self) -> bool {
        self.is_connected.load(Ordering::SeqCst)
    }

    fn mtu(&self) -> u16 {
        MTU
    }

    fn subscribe(&self, number: u8) -> Result<(), String> {
        self.request(json!({"do": "subscribe", "phone": COMPUTER, "to": uuid(number)})).map(drop)
    }

    fn write(&self, number: u8, value: &[u8]) -> Result<(), String> {
        let value: String = value.iter().map(|byte| format!("{byte:02x}")).collect();
        self.request(json!({"do": "write", "phone": COMPUTER, "of": uuid(number), "value": value})).map(drop)
    }
}

impl Drop for Radio {
    fn drop(&mut self) {
        // The process may have ended already.
        let python = self.python.get_mut().unwrap_or_else(PoisonError::into_inner);
        let _ = python.kill();
        let _ = python.wait();
    }
}
